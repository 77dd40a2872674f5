"""The falling apple as a Filippov system.

    y' = -1 above the ground,   y' in [-1, 0] on it,   y' = 0 below,   y(0) = y0

The same fall as the complementarity form while y >= 0, and another problem below: nothing pushes back, an
infeasible start stays where it is. On the ground both surface conditions vanish together (the lower field is
tangential and the weight is 0), which methods that detect a switch by the weights feel as a degeneracy.
Exact: y = max(y0 - t, 0) with weight 1 up to t = y0 for y0 >= 0, else y = y0 with weight 0.
"""
import numpy as np

from nsbench import Case, Filippov


def fall(xp):
    def f(t, y):
        return -xp.ones_like(y)
    return f


def rest(xp):
    def f(t, y):
        return xp.zeros_like(y)
    return f


def height(xp):
    def c(t, y):
        return y
    return c


def make(y0: float = 1.0) -> Case:
    """y0: start height; negative starts are infeasible and stay."""
    land = max(y0, 0.0)

    def exact(t):
        return (y0 - np.minimum(t, land))[:, None]

    def exact_impulse(t):
        return np.minimum(t, land)[:, None]

    return Case(
        name="apple_filippov",
        problem=Filippov({(+1,): fall, (-1,): rest}, height),
        x0=np.array([y0]),
        t=np.linspace(0.0, 2.0, 41),
        exact=exact, exact_impulse=exact_impulse, exact_events=(land,) if 0.0 < land < 2.0 else (),
        tags=("exact_at_grid",),
    )
