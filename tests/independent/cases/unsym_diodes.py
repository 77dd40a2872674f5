"""B is not C^T: three diodes, D = 0."""
import numpy as np

from nsbench import LCS, Case


def u(xp):
    def f(t):
        return xp.array([0.8 * xp.cos(t), -1.0 + 0.5 * xp.sin(2.0 * t), -0.6 * xp.cos(0.7 * t)])
    return f


CASE = Case(
    name="unsym_diodes",
    problem=LCS(
        np.array([[-0.1, 0.4, 0.0], [-0.4, -0.1, 0.2], [0.0, 0.0, -0.3]]),
        np.array([[1.0, 0.2, 0.0], [0.1, 0.9, -0.2], [0.0, 0.3, 1.0]]),
        np.array([[1.0, 0.0, 0.1], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
        np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]),
        u=u,
    ),
    x0=np.array([0.5, 0.4, 0.3]),
    t=np.linspace(0.0, 12.0, 49),
)
