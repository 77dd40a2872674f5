"""The push against a wall has a pole in time: steps crept towards it, shorter and shorter, and did
not come to an end."""

import numpy as np

from nsbench import Affine, Case, Complementarity


def drift(xp):
    def f(t, x):
        return xp.array([1e8 * (0.5 / (t - 0.967))])

    return f


CASE = Case(
    name="scene",
    problem=Complementarity(drift, (Affine(np.array([[1.0]]), np.array([3e7])),)),
    x0=np.array([0.0]),
    t=np.linspace(0.0, 2.0, 21),
)

BY = ("event_driven",)
