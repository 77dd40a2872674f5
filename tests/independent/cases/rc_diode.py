"""RC circuit with a diode and a resistor, D > 0."""
import numpy as np

from nsbench import LCS, Case


def q(xp):
    def f(t):
        return xp.array([-2.0 * xp.sin(2.0 * t) - 0.5 * xp.sin(5.0 * t)])
    return f


CASE = Case(
    name="rc_diode",
    problem=LCS(np.array([[-0.3]]), np.array([[1.0]]), np.array([[1.0]]), np.array([[0.5]]), q=q),
    x0=np.array([0.1]),
    t=np.linspace(0.0, 10.0, 41),
)
