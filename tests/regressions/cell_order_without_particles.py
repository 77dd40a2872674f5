"""A curved wall and no particles: the order by cells had nothing to number and raised."""

import numpy as np

from nsbench import Case, Complementarity, Smooth


def g(xp):
    def f(t, x):
        return xp.array([1.0 - x[0] ** 2])

    return f


def drift(xp):
    def f(t, x):
        return xp.array([1.0])

    return f


CASE = Case(
    name="scene",
    problem=Complementarity(drift, (Smooth(g),)),
    x0=np.array([0.0]),
    t=np.linspace(0.0, 2.0, 6),
)

BY = ("pbd[order=cell]", "pbd", "event_driven")
