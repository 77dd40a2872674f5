"""Play: a point without any drift of its own, pushed to and fro by two jaws 2 r apart (hysteresis).

    x' = lam1 - lam2,   g1 = x - (u - r) >= 0,   g2 = (u + r) - x >= 0,   u = sin t + sin(sqrt(2) t) / 3

Exact: the play operator. Between two turning points of u (roots of u') the jaws move one way and
x = clip(x at the turning point, u - r, u + r). The impulse of a jaw is what it has moved the point, lam = |u'|: both
together are the total variation of x. What it is for: everything comes from dg/dt; at each turn one jaw lets go
and the other takes over after a pause. Projecting methods are exact but for the steps that hold a turning
point, which cost O(h^2): no order one to be seen here.
"""
import numpy as np

from nsbench import Affine, Case, Complementarity

R, T, SECOND = 0.35, 10.0, 2.0 ** 0.5


def centre(t):
    return np.sin(t) + np.sin(SECOND * t) / 3.0


def zeros(f, grid):
    """Zeros of the vectorised f, one in each interval of the grid where it changes sign, by bisection."""
    at = np.flatnonzero(np.sign(f(grid[:-1])) * np.sign(f(grid[1:])) < 0)
    low, high = grid[at], grid[at + 1]
    left = np.sign(f(low))
    for _ in range(80):
        mid = 0.5 * (low + high)
        same = np.sign(f(mid)) == left
        low, high = np.where(same, mid, low), np.where(same, high, mid)
    return 0.5 * (low + high)


FINE = np.linspace(0.0, T, 2001)
TURNS = np.concatenate(([0.0], zeros(lambda t: np.cos(t) + SECOND / 3.0 * np.cos(SECOND * t), FINE)))


def held(values):
    """Place of the point at each turn, from the play recursion."""
    x = [0.0]
    for u in values:
        x.append(float(np.clip(x[-1], u - R, u + R)))
    return np.array(x[1:])


AT_TURNS = held(centre(TURNS))
MOVED = np.diff(AT_TURNS)
PUSHED = np.vstack((np.zeros(2), np.cumsum(np.stack((np.maximum(MOVED, 0), np.maximum(-MOVED, 0)), axis=1), axis=0)))


def exact(t):
    last = AT_TURNS[np.searchsorted(TURNS, t, side="right") - 1]
    return np.clip(last, centre(t) - R, centre(t) + R)[:, None]


def exact_impulse(t):
    k = np.searchsorted(TURNS, t, side="right") - 1
    since = exact(t)[:, 0] - AT_TURNS[k]
    return PUSHED[k] + np.stack((np.maximum(since, 0.0), np.maximum(-since, 0.0)), axis=1)


def pick_up():
    """Times at which a jaw reaches the point again after a turn."""
    out = []
    for a, b, x in zip(TURNS, np.append(TURNS[1:], T), AT_TURNS, strict=True):
        grid = np.linspace(a, b, 201)[1:]
        out += [zeros(lambda t, x=x, s=s: centre(t) + s * R - x, grid) for s in (1, -1)]
    return np.concatenate(out)


def drift(xp):
    def f(t, x):
        return 0.0 * x
    return f


def jaws(xp):
    sides = np.array([-1.0, 1.0])
    def b(t):
        return sides * (xp.sin(t) + xp.sin(SECOND * t) / 3.0) + R
    return b


CASE = Case(
    name="play",
    problem=Complementarity(drift, (Affine(np.array([[1.0], [-1.0]]), jaws),)),
    x0=np.zeros(1),
    t=np.linspace(0.0, T, 51),
    exact=exact, exact_impulse=exact_impulse, exact_events=tuple(np.sort(np.concatenate((TURNS[1:], pick_up())))),
    substeps=16,
)
SUITES = {"full": [{}]}
