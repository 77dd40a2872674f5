"""Peak detector: ideal diode and capacitor."""
import numpy as np

from nsbench import LCS, Case


def q(xp):
    def f(t):
        return xp.array([-1.5 * xp.sin(3.0 * t)])
    return f


CASE = Case(
    name="rectifier",
    problem=LCS(np.array([[-0.4]]), np.array([[1.0]]), np.array([[1.0]]), np.array([[0.0]]), q=q),
    x0=np.array([0.2]),
    t=np.linspace(0.0, 8.0, 41),
)
