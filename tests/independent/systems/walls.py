"""Points above floors, between walls that stand, move or turn."""

import itertools
import math
from functools import partial

from engine import Path, closed, columns, linspace, system
from modes import Gap, affine, complementarity
from mpmath import acos, ceil, cos, findroot, mpf, pi, sin


@system()
def tide_many():
    return complementarity(
        lambda t, x: [cos(t) - mpf(0.2)], [affine([1])], [0.5], linspace(0, 70, 141), H=0.25
    )


@system()
def tide_fast50():
    return complementarity(
        lambda t, x: [20 * cos(50 * t) - 1], [affine([1])], [0.3], linspace(0, 2, 41), H=0.01
    )


@system()
def jump_forcing():
    return complementarity(
        [
            lambda t, x: [-1 - mpf(0.1) * x[0]],
            lambda t, x: [mpf(0.7) - mpf(0.1) * x[0]],
            lambda t, x: [-2 - mpf(0.1) * x[0]],
        ],
        [affine([1])],
        [0.5],
        linspace(0, 4, 41),
        H=0.25,
        breaks=[1.03, 2.17],
    )


@system(events="none")
def touch_tangent():
    return closed(
        [(None, lambda t: [(t - 1) ** 2], lambda t: [0])], linspace(0, 3, 31), columns(1), []
    )


@system()
def wall_moving():
    return complementarity(
        lambda t, x: [mpf(0.1) - x[0] / 2],
        [affine([1], lambda t: -mpf(0.8) * sin(2 * t), lambda t: -2 * mpf(0.8) * cos(2 * t))],
        [0.5],
        linspace(0, 12, 61),
        H=0.1,
    )


@system()
def wall_rest():
    return complementarity(
        lambda t, x: [mpf(0)],
        [affine([1], lambda t: cos(t), lambda t: -sin(t))],
        [0.5],
        linspace(0, 8, 41),
        H=0.2,
    )


@system()
def wall_rotating():
    return complementarity(
        lambda t, x: [mpf(0.3), mpf(-1)],
        [
            Gap(
                lambda t, x: cos(t) * x[0] + sin(t) * x[1] + mpf(0.5),
                lambda t, x: [cos(t), sin(t)],
                lambda t, x: -sin(t) * x[0] + cos(t) * x[1],
            )
        ],
        [1, 0],
        linspace(0, 9, 46),
        H=0.1,
    )


@system()
def walls_two():
    return complementarity(
        lambda t, x: [3 * cos(2 * t) + sin(5 * t) / 2],
        [
            affine([1], lambda t: mpf(0.5) + mpf(0.3) * sin(t), lambda t: mpf(0.3) * cos(t)),
            affine(
                [-2],
                lambda t: mpf(0.6) + mpf(0.2) * cos(mpf(1.7) * t),
                lambda t: -mpf(0.2) * mpf(1.7) * sin(mpf(1.7) * t),
            ),
        ],
        [0],
        linspace(0, 10, 51),
        H=0.05,
    )


def tide(w, p, a, y, ts, k):
    """(states, impulses, events) of y' = cos(w t + p) - a above a floor: F is the integral of the
    force.

    A contact is bracketed on a grid of 1e-3, a thousandth of the fastest period; a release is where
    the force turns up.
    """
    F = lambda t: sin(w * t + p) / w - a * t
    start = mpf(0)
    stored = mpf(0)
    pieces = []
    events = []
    while start < ts[-1]:
        free = partial(lambda t, c: c + F(t), c=y - F(start))
        rough = lambda s, c=float(y - F(start)): (
            c + math.sin(float(w) * s + float(p)) / float(w) - float(a) * s
        )
        s = next(
            s
            for s in (float(start) + 1e-3 * i for i in itertools.count(1))
            if s > ts[-1] or rough(s) <= 0
        )
        if s > ts[-1]:
            pieces.append((mpf(s), free, lambda t, c=stored: c))
            break
        hit = findroot(free, (mpf(s - 1e-3), mpf(s)), solver="anderson", tol=mpf(10) ** -70)
        turn = ceil((w * hit + p + acos(a)) / (2 * pi))
        let = (2 * pi * turn - acos(a) - p) / w
        pieces += [
            (hit, free, lambda t, c=stored: c),
            (let, lambda t: mpf(0), lambda t, c=stored + F(hit): c - F(t)),
        ]
        events += [
            (s, kind, (0, k)) for s, kind in ((hit, "contact"), (let, "release")) if s < ts[-1]
        ]
        start = let
        y = mpf(0)
        stored = stored + F(hit) - F(let)
    at = [next(piece for piece in pieces if t <= piece[0]) for t in ts]
    return (
        [q[1](t) for q, t in zip(at, ts, strict=True)],
        [q[2](t) for q, t in zip(at, ts, strict=True)],
        events,
    )


@system()
def many10():
    ts = linspace(0, 15, 61)
    data = [
        [mpf(round(v, 2)) for v in (1.0 + 0.37 * k, 0.3 * k, 0.1 + 0.02 * k, 0.5 + 0.05 * k)]
        for k in range(10)
    ]
    x, impulse, events = zip(*(tide(*d, ts, k) for k, d in enumerate(data)), strict=True)
    return Path(
        ts,
        [*zip(*x, strict=True)],
        [*zip(*impulse, strict=True)],
        sorted(itertools.chain(*events)),
        columns(10),
    )


@system(events="none")
def lam_zero():
    return closed(
        [(None, lambda t: [t, 0, sin(t)], lambda t: [0, 0])], linspace(0, 5, 26), columns(2), []
    )


@system()
def long_slide():
    return complementarity(
        lambda t, x: [
            1 + mpf(0.2) * sin(x[0]),
            -1 + (t / 90) ** 2 + mpf(0.1) * cos(x[0]) * (1 - t / 90),
        ],
        [affine([0.1, 1])],
        [0, 0.5],
        linspace(0, 100, 101),
        H=0.2,
    )


@system()
def vdp_clipped():
    return complementarity(
        lambda t, x: [x[1], 2 * (1 - x[0] ** 2) * x[1] - x[0]],
        [affine([-1, 0], mpf(1.5)), affine([1, 0], mpf(1.5)), affine([0, 1], mpf(2.5))],
        [0.5, 0],
        linspace(0, 20, 81),
        H=0.05,
    )
