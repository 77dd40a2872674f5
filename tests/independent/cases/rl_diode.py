"""RL circuit with an ideal diode in series."""
import numpy as np

from nsbench import LCS, Case


def u(xp):
    def f(t):
        return xp.array([2.0 * xp.sin(2.0 * t)])
    return f


CASE = Case(
    name="rl_diode",
    problem=LCS(np.array([[-0.7]]), np.array([[1.0]]), np.array([[1.0]]), np.array([[0.0]]), u=u),
    x0=np.array([0.0]),
    t=np.linspace(0.1, 10.0, 41),
)
