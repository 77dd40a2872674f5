"""Discs, rods, ropes and chains."""

from engine import closed, linspace, system
from modes import anchor, complementarity, dist
from mpmath import cos, exp, log, mpf, pi, sin, sqrt

TRIANGLE = [(0, 0, 1), (0, 0, 2), (0, 1, 2)]


@system()
def out_disc():
    return complementarity(
        lambda t, x: [mpf(1), mpf(0)],
        [anchor(0, lambda t: [0, 0], lambda t: [0, 0], 1, 2)],
        [-3.0, 0.2],
        linspace(0, 8, 41),
        H=0.1,
        ids=[(0, 0, 0)],
    )


@system()
def sphere_3d():
    return complementarity(
        lambda t, x: [mpf(1), mpf(0.2) * sin(t), -mpf(0.3) * x[2]],
        [anchor(0, lambda t: [0, 0, 0], lambda t: [0, 0, 0], 0.8, 3, dim=3)],
        [-2.0, 0.1, 0.2],
        linspace(0, 9, 46),
        H=0.1,
        ids=[(0, 0, 0)],
    )


@system()
def rope_fixed():
    return complementarity(
        lambda t, x: [cos(t), sin(mpf(1.3) * t)],
        [anchor(0, lambda t: [mpf(0.2), mpf(-0.1)], lambda t: [0, 0], 1, 2, sign=-1)],
        [0.3, 0.3],
        linspace(0, 14, 57),
        H=0.1,
        ids=[(0, 0, 0)],
    )


@system()
def rope_towed():
    return complementarity(
        lambda t, x: [-mpf(0.4) * x[0] + sin(3 * t) / 2, -mpf(0.4) * x[1] - mpf(0.2)],
        [
            anchor(
                0,
                lambda t: [mpf(1.5) * cos(t), sin(t)],
                lambda t: [-mpf(1.5) * sin(t), cos(t)],
                mpf(0.7),
                2,
                sign=-1,
            )
        ],
        [1.2, -0.1],
        linspace(0, 12, 49),
        H=0.05,
        ids=[(0, 0, 0)],
    )


@system()
def rope_3d():
    return complementarity(
        lambda t, x: [
            cos(t),
            mpf(0.4) * sin(2 * t),
            mpf(-0.5),
            -mpf(0.6) * sin(t),
            cos(mpf(1.2) * t),
            mpf(0.3) * cos(t) - mpf(0.1) * x[5],
        ],
        [
            anchor(0, lambda t: [0, 0, 0], lambda t: [0, 0, 0], 1, 6, dim=3, sign=-1),
            dist(0, 1, 0.8, 6, 3, -1),
        ],
        [0.1, 0.0, 0.1, 0.5, 0.1, 0.0],
        linspace(0, 10, 41),
        H=0.1,
        ids=[(0, 0, 0), (1, 0, 1)],
    )


@system()
def rods_1d():
    return complementarity(
        lambda t, x: [
            -x[0] + mpf(1.2) * sin(t) - 1,
            -x[1] + mpf(0.6) * cos(2 * t),
            -x[2] + mpf(1.3) + mpf(0.9) * sin(mpf(1.5) * t),
        ],
        [dist(0, 1, 0.5, 3, 1), dist(0, 2, 0.5, 3, 1), dist(1, 2, 0.5, 3, 1)],
        [-1, 0, 1],
        linspace(0, 12, 49),
        H=0.1,
        ids=TRIANGLE,
    )


@system()
def discs3_rot():
    def f(t, x):
        c = cos(t)
        s = sin(2 * t)
        h = mpf(0.5)
        return [
            -x[0] - h * x[1] + mpf(0.8) * c,
            -x[1] + h * x[0],
            -x[2] - h * x[3],
            -x[3] + h * x[2] + mpf(0.9) * s,
            -x[4] - h * x[5] - mpf(0.7) * c,
            -x[5] + h * x[4] - mpf(0.6) * s,
        ]

    return complementarity(
        f,
        [dist(0, 1, 0.6, 6), dist(0, 2, 0.6, 6), dist(1, 2, 0.6, 6)],
        [-1.0, 0.1, 0.9, 0.3, 0.2, -1.1],
        linspace(0, 10, 41),
        H=0.1,
        ids=TRIANGLE,
    )


@system()
def discs2_spin():
    return complementarity(
        lambda t, x: [
            mpf(0.8) * cos(mpf(0.8) * t),
            mpf(0.05),
            -mpf(0.8) * cos(mpf(0.8) * t),
            -mpf(0.05) * cos(t),
        ],
        [dist(0, 1, 0.5, 4)],
        [-0.6, 0.05, 0.6, -0.05],
        linspace(0, 8, 41),
        H=0.1,
        ids=[(0, 0, 1)],
    )


@system()
def discs_radii():
    def f(t, x):
        return [
            -mpf(1.5) * x[0] + sin(t) / 2,
            -x[1],
            -x[2],
            -mpf(1.5) * x[3] + mpf(0.7) * cos(mpf(1.3) * t),
            -x[4] + mpf(0.4) * cos(t),
            -x[5] - mpf(0.3),
        ]

    r = [mpf(0.2), mpf(0.5), mpf(0.35)]
    return complementarity(
        f,
        [dist(i, j, r[i] + r[j], 6) for _, i, j in TRIANGLE],
        [-1.2, 0.2, 0.8, 0.5, 0.1, -1.0],
        linspace(0, 8, 41),
        H=0.1,
        ids=TRIANGLE,
    )


@system()
def three_symm():
    """Radius r = e^-t until sqrt(3) r = 0.6, then a rigid triangle with 2 lam cos 30 = r."""
    r1 = mpf(0.6) / sqrt(3)
    t1 = -log(r1)
    w = mpf(0.7)

    def x(t):
        r = exp(-min(t, t1))
        o = []
        for k in range(3):
            a = 2 * pi * k / 3 + w * t
            o += [r * cos(a), r * sin(a)]
        return o

    return closed(
        [(None, x, lambda t: [max(t - t1, 0) * r1 / sqrt(3)] * 3)],
        linspace(0, 4, 41),
        TRIANGLE,
        [(t1, "contact", i) for i in TRIANGLE],
    )


@system()
def cradle():
    return complementarity(
        lambda t, x: [
            mpf(1),
            mpf(0),
            mpf(0.1) * cos(t),
            mpf(0.05),
            -mpf(0.6) + mpf(0.4) * t,
            -mpf(0.05) * t,
        ],
        [dist(i, j, 0.4, 6) for _, i, j in TRIANGLE],
        [-1.5, 0.0, 0.0, 0.1, 0.9, 0.05],
        linspace(0, 6, 31),
        H=0.05,
        ids=TRIANGLE,
    )


@system()
def chain3():
    def f(t, x):
        c = cos(mpf(0.8) * t)
        s = sin(mpf(0.8) * t)
        k = mpf(0.3)
        return [k * c, k * s, k * c - mpf(0.1), k * s, mpf(1.2) * c, mpf(1.2) * s]

    return complementarity(
        f,
        [
            anchor(0, lambda t: [0, 0], lambda t: [0, 0], 1, 6, sign=-1),
            dist(0, 1, 1, 6, 2, -1),
            dist(1, 2, 1, 6, 2, -1),
        ],
        [0.5, 0.1, 1.1, 0.3, 1.8, 0.2],
        linspace(0, 8, 41),
        H=0.1,
        ids=[(0, 0, 0), (1, 0, 1), (1, 1, 2)],
    )


@system()
def chain_pulled():
    def f(t, x):
        return [
            -x[0] / 2,
            -x[1] / 2 - mpf(0.2),
            -x[2] / 2,
            -x[3] / 2 - mpf(0.2),
            -x[4] / 2,
            -x[5] / 2 - mpf(0.2),
        ]

    k = mpf(0.7)
    return complementarity(
        f,
        [
            anchor(
                0,
                lambda t: [2 * sin(t), cos(k * t)],
                lambda t: [2 * cos(t), -k * sin(k * t)],
                0.5,
                6,
                sign=-1,
            ),
            dist(0, 1, 0.5, 6, 2, -1),
            dist(1, 2, 0.5, 6, 2, -1),
        ],
        [0.1, 0.7, 0.0, 0.5, 0.1, 0.3],
        linspace(0, 8, 41),
        H=0.05,
        ids=[(0, 0, 0), (1, 0, 1), (1, 1, 2)],
    )


@system()
def bar_range():
    return complementarity(
        lambda t, x: [cos(2 * t), mpf(0.3) * sin(t), -cos(2 * t), mpf(0.5)],
        [dist(0, 1, 0.8, 4), dist(0, 1, 1, 4, 2, -1)],
        [0.0, 0.0, 0.85, 0.2],
        linspace(0, 8, 41),
        H=0.05,
        ids=[(0, 0, 1), (1, 0, 1)],
    )
