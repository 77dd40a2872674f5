"""A relay x' = a(t) - sgn(x) as an LCS."""
import numpy as np

from nsbench import LCS, Case


def u(xp):
    def f(t):
        return xp.array([1.4 * xp.sin(1.5 * t) - 1.0])
    return f


def q(xp):
    def f(t):
        return xp.array([0.0, 2.0])
    return f


CASE = Case(
    name="relay_lcs",
    problem=LCS(
        np.array([[0.0]]), np.array([[1.0, 0.0]]), np.array([[1.0], [0.0]]), np.array([[0.0, 1.0], [-1.0, 0.0]]), u=u, q=q
    ),
    x0=np.array([0.5]),
    t=np.linspace(0.0, 10.0, 51),
)
