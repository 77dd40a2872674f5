"""Two coupled diodes, D > 0."""
import numpy as np

from nsbench import LCS, Case


def q(xp):
    def f(t):
        return xp.array([-2.0 * xp.sin(2.0 * t), -1.5 * xp.cos(1.3 * t)])
    return f


CASE = Case(
    name="two_diodes",
    problem=LCS(
        np.array([[-0.3, 0.5], [-0.5, -0.2]]),
        np.array([[1.0, 0.2], [-0.3, 1.0]]),
        np.array([[1.0, 0.1], [0.0, 1.0]]),
        np.array([[0.5, 0.2], [-0.1, 0.3]]),
        q=q,
    ),
    x0=np.array([0.1, 0.4]),
    t=np.linspace(0.0, 10.0, 41),
)
