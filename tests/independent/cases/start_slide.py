"""Start on the surface: slide, then exit."""
import numpy as np

from nsbench import Case, Filippov


def drift(xp):
    def f(t, x):
        return xp.array([1.0, 0.4 * t])
    return f


def switch(xp):
    def f(t, x):
        return xp.array([x[1]])
    return f


CASE = Case(
    name="start_slide",
    problem=Filippov.relay(drift, np.array([[0.3], [-1.0]]), switch),
    x0=np.array([0.0, 0.0]),
    t=np.linspace(0.0, 5.0, 26),
)
