"""Two diodes in parallel: lambda is not unique, B lambda is."""
import numpy as np

from nsbench import LCS, Case


def q(xp):
    def f(t):
        return xp.array([-1.2 * xp.sin(2.0 * t), -1.2 * xp.sin(2.0 * t)])
    return f


CASE = Case(
    name="parallel_diodes",
    problem=LCS(np.array([[-0.5]]), np.array([[1.0, 1.0]]), np.array([[1.0], [1.0]]), np.array([[0.0, 0.0], [0.0, 0.0]]), q=q),
    x0=np.array([0.3]),
    t=np.linspace(0.0, 8.0, 41),
)
