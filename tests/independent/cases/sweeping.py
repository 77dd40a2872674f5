"""The sweeping process x' = lambda, x >= -q(t)."""
import numpy as np

from nsbench import LCS, Case


def q(xp):
    def f(t):
        return xp.array([-xp.cos(t - 1.0) - 0.3 * xp.cos(3.0 * t)])
    return f


CASE = Case(
    name="sweeping",
    problem=LCS(np.array([[0.0]]), np.array([[1.0]]), np.array([[1.0]]), np.array([[0.0]]), q=q),
    x0=np.array([0.9]),
    t=np.linspace(0.0, 9.0, 46),
)
