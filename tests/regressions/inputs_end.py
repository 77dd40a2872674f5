"""An input with a logarithm that ends with the run: LSODA went on in steps of no length."""

import numpy as np

from nsbench import LCS, Case


def u(xp):
    def f(t):
        return xp.array([-0.5 * xp.log(1.0 - t)])

    return f


CASE = Case(
    name="scene",
    problem=LCS(np.array([[0.8]]), np.array([[0.5]]), np.array([[0.5]]), np.array([[1.0]]), u=u),
    x0=np.array([0.2]),
    t=np.linspace(0.0, 1.0, 2),
)

BY = ("event_driven[method=lsoda]", "event_driven")
