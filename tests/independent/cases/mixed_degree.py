"""One diode of relative degree 0 and one of degree 1: D = diag(0.5, 0)."""
import numpy as np

from nsbench import LCS, Case


def u(xp):
    def f(t):
        return xp.array([0.3 * xp.sin(t), -1.1 * xp.cos(1.6 * t) - 0.2])
    return f


def q(xp):
    def f(t):
        return xp.array([-xp.sin(2.0 * t), 0.2])
    return f


CASE = Case(
    name="mixed_degree",
    problem=LCS(
        np.array([[-0.4, 0.3], [0.1, -0.2]]),
        np.array([[0.0, 0.5], [0.4, 1.0]]),
        np.array([[1.0, 0.0], [0.0, 1.0]]),
        np.array([[0.5, 0.0], [0.0, 0.0]]),
        u=u,
        q=q,
    ),
    x0=np.array([0.2, 0.5]),
    t=np.linspace(0.0, 10.0, 51),
)
