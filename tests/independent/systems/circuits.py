"""Circuits of diodes, a relay and a sweeping process: linear complementarity systems."""

import itertools
from dataclasses import dataclass, replace
from functools import partial

from engine import Path, linspace, march, system
from modes import affine, changes, circuit, complementarity, const, dot, filippov
from mpmath import cos, mpf, sin


def lin(A, u=None):
    """A x + u(t)."""
    A = [[mpf(v) for v in r] for r in A]
    return lambda t, x: [
        dot(r, x) + c for r, c in zip(A, u(t) if u else [mpf(0)] * len(A), strict=True)
    ]


def pad(path):
    """All the impulse on the first of two parallel diodes."""
    return replace(path, impulse=[[r[0], mpf(0)] for r in path.impulse], ids=[(0, 0), (0, 1)])


@system()
def rectifier():
    return complementarity(
        lin([[-0.4]]),
        [affine([1], lambda t: -mpf(1.5) * sin(3 * t), lambda t: -mpf(4.5) * cos(3 * t))],
        [0.2],
        linspace(0, 8, 41),
        H=0.1,
        directions=[[1]],
    )


@system()
def rl_diode():
    return complementarity(
        lin([[-0.7]], lambda t: [2 * sin(2 * t)]),
        [affine([1])],
        [0],
        linspace(0.1, 10, 41),
        H=0.1,
        directions=[[1]],
    )


@system()
def rc_diode():
    return circuit(
        [[-0.3]],
        [[1]],
        [[1]],
        [[0.5]],
        lambda t: [mpf(0)],
        lambda t: [-2 * sin(2 * t) - sin(5 * t) / 2],
        [0.1],
        linspace(0, 10, 41),
        H=0.1,
    )


@system()
def two_diodes():
    return circuit(
        [[-0.3, 0.5], [-0.5, -0.2]],
        [[1.0, 0.2], [-0.3, 1.0]],
        [[1.0, 0.1], [0.0, 1.0]],
        [[0.5, 0.2], [-0.1, 0.3]],
        lambda t: [mpf(0), mpf(0)],
        lambda t: [-2 * sin(2 * t), -mpf(1.5) * cos(mpf(1.3) * t)],
        [0.1, 0.4],
        linspace(0, 10, 41),
        H=0.1,
    )


@system()
def two_diodes_d0():
    k = mpf(1.3)
    return complementarity(
        lin([[-0.3, 0.5], [-0.5, -0.2]]),
        [
            affine([1, 0], lambda t: -2 * sin(2 * t) - mpf(0.3), lambda t: -4 * cos(2 * t)),
            affine(
                [0, 1],
                lambda t: -mpf(1.5) * cos(k * t) - mpf(0.2),
                lambda t: mpf(1.5) * k * sin(k * t),
            ),
        ],
        [0.6, 2],
        linspace(0, 10, 41),
        H=0.1,
        directions=[[1.0, 0.3], [0.3, 0.8]],
    )


@system(events="times", weights=((1, 1),))
def parallel_diodes():
    return pad(
        complementarity(
            lin([[-0.5]]),
            [affine([1], lambda t: -mpf(1.2) * sin(2 * t), lambda t: -mpf(2.4) * cos(2 * t))],
            [0.3],
            linspace(0, 8, 41),
            H=0.1,
            directions=[[1]],
        )
    )


@system(events="times", weights=((1, 1),))
def parallel_res():
    return pad(
        circuit(
            [[-0.5]],
            [[1]],
            [[1]],
            [[0.4]],
            lambda t: [mpf(0)],
            lambda t: [-mpf(1.2) * sin(2 * t)],
            [0.3],
            linspace(0, 8, 41),
            H=0.1,
        )
    )


@system()
def relay_lcs():
    """As a Filippov system: lam_1 = 1 - s, lam_2 = max(-x, 0), whose integral is a second state."""
    path = filippov(
        lambda t, x, s: [mpf(1.4) * sin(mpf(1.5) * t) - s[0], -x[0] * (1 - s[0]) / 2],
        lambda t, x: [x[0]],
        const([1, 0]),
        [0.5, 0],
        linspace(0, 10, 51),
        H=0.1,
    )
    acting = {"+": (), "s": (0,), "-": (0, 1)}
    modes = [(t, acting[c]) for t, c in path.modes]
    events = [
        (t, *e)
        for (_, a), (t, b) in itertools.pairwise(modes)
        for e in changes([(0, 0), (0, 1)], a, b)
    ]
    impulse = [[2 * (t - w[0]), x[1]] for t, w, x in zip(path.t, path.impulse, path.x, strict=True)]
    return Path(path.t, [x[:1] for x in path.x], impulse, events, [(0, 0), (0, 1)])


@system()
def sweeping():
    return complementarity(
        lin([[0]]),
        [
            affine(
                [1],
                lambda t: -cos(t - 1) - mpf(0.3) * cos(3 * t),
                lambda t: sin(t - 1) + mpf(0.9) * sin(3 * t),
            )
        ],
        [0.9],
        linspace(0, 9, 46),
        H=0.1,
        directions=[[1]],
    )


@dataclass(frozen=True)
class MixedDegree:
    """Diode 0 behind a resistor, lam_0 = -2 w_0; diode 1 ideal, lam_1 holds x_1 at its bound."""

    ids: tuple = ((0, 0), (0, 1))

    def drift(self, active, t, x):
        """(lam_0, free velocity of x_1)."""
        lam = 2 * (sin(2 * t) - x[0]) if 0 in active else mpf(0)
        return lam, mpf(0.1) * x[0] - mpf(0.2) * x[1] - mpf(1.1) * cos(mpf(1.6) * t) - mpf(
            0.2
        ) + mpf(0.4) * lam

    def lam(self, active, t, x):
        first, v = self.drift(active, t, x)
        return [first, -v if 1 in active else mpf(0)]

    def velocity(self, active, t, x):
        lam = self.lam(active, t, x)
        return [
            mpf(-0.4) * x[0] + mpf(0.3) * x[1] + mpf(0.3) * sin(t) + lam[1] / 2,
            self.drift(active, t, x)[1] + lam[1],
        ]

    def parts(self, active, era, t, x):
        w = (lambda t, x: x[0] - sin(2 * t), lambda t, x: x[1] + mpf(0.2))
        guards = [
            (k, (lambda t, x, k=k: self.lam(active, t, x)[k]) if k in active else w[k])
            for k in range(2)
        ]
        return partial(self.velocity, active), partial(self.lam, active), guards

    def decide(self, t, x, mode, tags, era):
        new = tuple(sorted(set(mode) ^ set(tags)))
        return new, changes(self.ids, mode, new)


@system()
def mixed_degree():
    return march(MixedDegree(), [0.2, 0.5], linspace(0, 10, 51), 0.1, mode=())


@system()
def unsym_diodes():
    B = [[1.0, 0.2, 0.0], [0.1, 0.9, -0.2], [0.0, 0.3, 1.0]]
    C = [[1.0, 0.0, 0.1], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    return complementarity(
        lin(
            [[-0.1, 0.4, 0.0], [-0.4, -0.1, 0.2], [0.0, 0.0, -0.3]],
            lambda t: [mpf(0.8) * cos(t), -1 + sin(2 * t) / 2, -mpf(0.6) * cos(mpf(0.7) * t)],
        ),
        [affine(r) for r in C],
        [0.5, 0.4, 0.3],
        linspace(0, 12, 49),
        H=0.1,
        directions=[[B[i][k] for i in range(3)] for k in range(3)],
    )
