"""Two discs meet 1e8 from the origin: impulses were asked for digits that their states do not have,
and steps grew too short to come to an end."""

import numpy as np

from nsbench import Case, Complementarity, Distance


def drift(xp):
    def f(t, x):
        x = x - 1e8
        return xp.array([1.0 - 0.4 * x[1], 0.3 * xp.sin(3.0 * t), -1.0, 0.4 * x[0]])

    return f


CASE = Case(
    name="scene",
    problem=Complementarity(drift, (Distance(d=1.0, dim=2),)),
    x0=1e8 + np.array([-1.0, 0.0, 1.0, 0.25]),
    t=np.linspace(0.0, 2.0, 11),
)

BY = ("event_driven", "event_driven[method=rk45]", "pbd", "catching_up")
