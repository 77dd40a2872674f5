"""Corners, redundant walls, contacts at one time or nearly so, starts on a wall."""

from dataclasses import replace

import numpy as np
from engine import closed, columns, linspace, system
from modes import affine, complementarity, eye
from mpmath import cos, mpf, pi, sin


def wedge(a):
    """The floor and a wall that leans at the angle a over it."""
    return [affine([0, 1]), affine([np.sin(a), -np.cos(a)])]


def with_reaction(path, rows):
    """The path with the reaction of walls with these constant rows."""
    return replace(
        path,
        reaction=[
            [sum(mpf(g[i]) * v for g, v in zip(rows, r, strict=True)) for i in range(len(rows[0]))]
            for r in path.impulse
        ],
    )


@system()
def corner_acute():
    return complementarity(
        lambda t, x: [cos(mpf(0.9) * t + mpf(2.5)), sin(mpf(0.9) * t + mpf(2.5))],
        wedge(0.6),
        [1.0, 0.3],
        linspace(0, 16, 65),
        H=0.1,
    )


@system()
def corner_obtuse():
    return complementarity(
        lambda t, x: [
            cos(mpf(0.9) * t + mpf(2.5)),
            mpf(1.2) * sin(mpf(0.9) * t + mpf(2.5)) - mpf(0.2),
        ],
        wedge(2.3),
        [1.0, 0.3],
        linspace(0, 16, 65),
        H=0.1,
    )


@system()
def corner_moving():
    return complementarity(
        lambda t, x: [cos(mpf(1.1) * t + 2), sin(mpf(1.1) * t + 2)],
        [
            affine([0, 1]),
            affine(
                [np.sin(1.1), -np.cos(1.1)],
                lambda t: mpf(0.2) * sin(2 * t),
                lambda t: mpf(0.4) * cos(2 * t),
            ),
            affine([-1, -1], lambda t: mpf(1.1) - mpf(0.1) * t, lambda t: -mpf(0.1)),
        ],
        [0.4, 0.1],
        linspace(0, 6, 31),
        H=0.05,
    )


@system(events="times", weights=())
def dup_rows():
    G = [[0.5, 1.0], [1.0, 2.0], [0.25, 0.5], [-1.0, 0.0]]
    b = [0.3, 0.6, 0.15, 0.6]
    return with_reaction(
        complementarity(
            lambda t, x: [mpf(0.3) * cos(t), sin(t) - mpf(0.4) + mpf(0.1) * x[0]],
            [affine(g, mpf(c)) for g, c in zip(G, b, strict=True)],
            [0.1, 0.2],
            linspace(0, 14, 57),
            H=0.1,
        ),
        G,
    )


@system(events="none", weights=())
def four_walls():
    G = [[-0.5, 0.0, 1.0], [0.5, 0.0, 1.0], [0.0, -0.5, 1.0], [0.0, 0.5, 1.0]]
    return with_reaction(
        complementarity(
            lambda t, x: [mpf(0.2) * cos(t), mpf(0.15) * sin(t), -mpf(1.5) + mpf(0.12) * t],
            [affine(g) for g in G],
            [0.3, -0.2, 1.0],
            linspace(0, 12, 49),
            H=0.1,
        ),
        G,
    )


@system()
def box_rot():
    return complementarity(
        lambda t, x: [
            mpf(1.5) * cos(mpf(1.3) * t) - mpf(0.3) * x[1],
            mpf(1.5) * sin(mpf(1.3) * t) + mpf(0.3) * x[0] * x[1],
        ],
        [affine(a, mpf(0.7)) for a in ([1, 0], [-1, 0], [0, 1], [0, -1])],
        [0.1, 0],
        linspace(0, 12, 49),
        H=0.05,
    )


@system()
def simul_exact():
    return complementarity(
        lambda t, x: [-cos(t), -2 * t + t * t / 2, -mpf(0.3) + x[0] + x[1]],
        eye(3),
        [float(np.sin(0.5)), 0.25 - 0.0625 / 3.0, 0.4],
        linspace(0, 6, 49),
        H=0.1,
    )


@system()
def simul_1e9():
    return complementarity(
        lambda t, x: [mpf(-1), -1 + mpf(0.3) * t],
        [affine([1, 0]), affine([0.6, 0.8])],
        [0.7, (1.4 * (0.7 + 1e-9) - 0.12 * (0.7 + 1e-9) ** 2 - 0.42) / 0.8],
        linspace(0, 8, 41),
        H=0.1,
    )


@system()
def simul_1e6():
    return complementarity(
        lambda t, x: [mpf(-1), -1 + x[0] / 2 + mpf(0.4) * t],
        eye(2),
        [0.7, 0.7 + 1e-6 - 0.5 * 0.245 - 0.2 * 0.49],
        linspace(0, 4, 41),
        H=0.1,
    )


@system()
def start_in():
    return complementarity(lambda t, x: [cos(t)], [affine([1])], [0], linspace(0, 8, 41), H=0.1)


@system(optional=(0,))
def start_out():
    return complementarity(
        lambda t, x: [-cos(t), -1 + mpf(0.3) * x[0] + mpf(0.2) * t],
        eye(2),
        [0, 0],
        linspace(0, 8, 41),
        H=0.1,
    )


@system(optional=(0,))
def start_tangent():
    """The first is back at 2 pi, the second, held to pi, too, and the third at 20/3: all after the
    end."""

    def x(t):
        return [1 - cos(t), mpf(0) if t <= pi else 1 + cos(t), t**3 / 3 - t**4 / 20]

    def i(t):
        return [0, 1 - cos(min(t, pi)), 0]

    return closed([(None, x, i)], linspace(0, 5, 41), columns(3), [(+pi, "release", (0, 1))])


@system(optional=(2,))
def at_sample():
    """The second arrives at the end: that contact may be told or not."""
    return closed(
        [
            (
                None,
                lambda t: [max(1 - t, 0), 2 - t, max(mpf(0.125) - t / 2, 0)],
                lambda t: [max(t - 1, 0), 0, max(t / 2 - mpf(0.125), 0)],
            )
        ],
        linspace(0, 2, 9),
        columns(3),
        [(mpf(0.25), "contact", (0, 2)), (mpf(1), "contact", (0, 0))],
    )


@system()
def release_at_sample():
    """y = ((t - 2)^2 - 1)/4 falls to 0 at 1; the force turns at 2."""
    return closed(
        [
            (1, lambda t: [(t - 2) ** 2 / 4 - mpf(0.25)], lambda t: [0]),
            (2, lambda t: [0], lambda t: [mpf(0.25) - (t - 2) ** 2 / 4]),
            (None, lambda t: [(t - 2) ** 2 / 4], lambda t: [mpf(0.25)]),
        ],
        linspace(0, 4, 9),
        columns(1),
        [(mpf(1), "contact", (0, 0)), (mpf(2), "release", (0, 0))],
    )
