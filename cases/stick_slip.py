"""Stick-slip: a block on a belt, held by friction that falls with the sliding speed.

    x' = v,   v' = -x + 1 / (1.2 - v)  for v < 0.2,   v' = -x - 1 / (0.8 + v)  for v > 0.2,   (x, v)(0) = (x0, 0)

The belt moves with 0.2. The block sticks to it while |x| <= 1, slips at x = 1 with a weight that vanishes, hence
tangentially, swings back and is caught again. Every slip starts at the same point: after the first one the motion is
periodic at once, a limit cycle with a sliding part. No closed form; the reference is stored.
"""
import numpy as np

from nsbench import Case, Filippov

BELT = 0.2


def slower(xp):
    def f(t, x):
        return xp.array([x[1], -x[0] + 1.0 / (1.2 - x[1])])
    return f


def faster(xp):
    def f(t, x):
        return xp.array([x[1], -x[0] - 1.0 / (0.8 + x[1])])
    return f


def belt(xp):
    def c(t, x):
        return x[1:2] - BELT
    return c


def make(x0: float = 0.5, T: float = 20.0) -> Case:
    """x0: where the block starts, at rest; T: end time (one cycle takes about 9.23)."""
    return Case(
        name="stick_slip",
        problem=Filippov({(+1,): faster, (-1,): slower}, belt),
        x0=np.array([x0, 0.0]),
        t=np.linspace(0.0, T, 51),
        substeps=8,
    )
