"""Turning in a box: a point in a box is blown round by a turning wind, from corner to corner.

    x' = (cos t, sin t) + wall forces,   0 <= x1, x2 <= side,   x(0) = (0.3, 0.4)

Exact: the coordinates do not know of each other, and each is a point between two stops. Between two turns of the wind
(zeros of cos t, of sin t) a coordinate moves one way, x = clip(x at the turn + sin t - sin of the turn, 0, side); what
the stop takes off is its impulse, so lam is the wind across the wall that is pressed on. A wall is left at the turn
after it was reached.

What it is for: two walls at once, entered and left one by one. In the unit box (side = 1) the wind carries the point
exactly from wall to wall in a quarter turn: from t = pi on it reaches each new wall at the very instant at which it
leaves the last one. A smaller box holds it in each corner for a while.
"""
from itertools import pairwise

import numpy as np

from nsbench import Affine, Case, Complementarity

START, T = (0.3, 0.4), 8.0
SUITES = {"standard": [{"side": 0.8}], "full": [{}]}


def drift(xp):
    def f(t, x):
        return xp.array([xp.cos(t), xp.sin(t)]) + 0.0 * x
    return f


def primitive(t, phase):
    """Integral of cos (phase 0) or of sin (phase 1)."""
    return -np.cos(t) if phase else np.sin(t)


def history(x0, side, phase):
    """Turns of the wind, the coordinate and the impulses (low, high) of its two stops at each of them."""
    turns = np.pi * (np.arange(4.0) + (0.0 if phase else -0.5))
    turns[0] = 0.0
    x, pressed = [x0], [np.zeros(2)]
    for a, b in pairwise(turns):
        free = x[-1] + primitive(b, phase) - primitive(a, phase)
        x.append(float(np.clip(free, 0.0, side)))
        pressed.append(pressed[-1] + [max(-free, 0.0), max(free - side, 0.0)])
    return turns, np.array(x), np.array(pressed)


def reached(turns, x, side, phase):
    """Times up to T at which the coordinate comes to a stop or leaves one."""
    out = []
    for k, turn in enumerate(turns):
        if k and x[k] in (0.0, side):
            out.append(turn)                            # the wind turns away from the stop
        up = k % 2 == 0                                 # the wind blows
        level = primitive(turn, phase) + (side - x[k] if up else -x[k])       # of the primitive at the stop
        if -1.0 <= level <= 1.0:
            rise = np.arccos(-level) if phase else np.arcsin(level)
            fall = (2 * np.pi if phase else np.pi) - rise
            out.append((rise if up else fall) + 2 * np.pi * (k // 2))
    return [t for t in out if 0.0 < t < T]


def make(side: float = 1.0) -> Case:
    """side: of the box, at least 0.5 and below 1.3 (the wind blows a point 2 far; the start is inside)."""
    if not 0.5 <= side < 1.3:
        raise ValueError(f"side is {side!r}; at least 0.5 and below 1.3")
    parts = [history(x0, side, phase) for phase, x0 in enumerate(START)]

    def coordinate(t, phase):
        turns, x, pressed = parts[phase]
        k = np.searchsorted(turns, t, side="right") - 1
        free = x[k] + primitive(t, phase) - primitive(turns[k], phase)
        return free, pressed[k]

    def exact(t):
        return np.stack([np.clip(coordinate(t, phase)[0], 0.0, side) for phase in (0, 1)], axis=1)

    def exact_impulse(t):
        out = np.empty((len(t), 4))
        for phase in (0, 1):
            free, before = coordinate(t, phase)
            out[:, 2 * phase] = before[:, 0] + np.maximum(-free, 0.0)
            out[:, 2 * phase + 1] = before[:, 1] + np.maximum(free - side, 0.0)
        return out

    events = np.sort(np.concatenate([reached(*p[:2], side, phase) for phase, p in enumerate(parts)]))
    events = events[np.append(True, np.diff(events) > 1e-12)]         # a wall reached as another is left: one event
    walls = np.repeat(np.eye(2), 2, axis=0) * np.array([[1.0], [-1.0], [1.0], [-1.0]])
    return Case(
        name="box_turning",
        problem=Complementarity(drift, (Affine(walls, np.array([0.0, side, 0.0, side])),)),
        x0=np.array(START),
        t=np.linspace(0.0, T, 41),
        exact=exact, exact_impulse=exact_impulse, exact_events=tuple(events), substeps=8,
    )
