"""A case of the gate studies for functions that no case of the catalogue has.

    x' = (1/2 - arctan(x1 + cos 2t) - log(2 + sin t) / 4,  -tanh(1 + x2 + sin(3t) / 2) - x1 / 4),
    0 <= x2 + log(1 + x1^2) / 8
"""

import numpy as np

from nsbench import Case, Complementarity, Smooth


def drift(xp):
    def f(t, x):
        along = 0.5 - xp.arctan(x[0:1] + xp.cos(2.0 * t)) - 0.25 * xp.log(2.0 + xp.sin(t))
        down = -xp.tanh(1.0 + x[1:2] + 0.5 * xp.sin(3.0 * t)) - 0.25 * x[0:1]
        return xp.concatenate((along, down))

    return f


def floor(xp):
    return lambda t, x: x[1:2] + 0.125 * xp.log(1.0 + x[0:1] * x[0:1])


def make(height: float = 0.7) -> Case:
    """height: x2 at the start; from 4 on the floor is not met."""
    return Case(
        name="curved_floor",
        problem=Complementarity(drift, (Smooth(floor),)),
        x0=np.array([0.2, height]),
        t=np.linspace(0.0, 3.0, 7),
    )
