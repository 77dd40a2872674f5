"""What is over in a blink: dips, spikes, bumps, near misses."""

from engine import closed, columns, linspace, system
from modes import affine, anchor, complementarity, const, filippov
from mpmath import cos, exp, log, mpf, sqrt


@system()
def dip_1e6():
    y0 = mpf(0.999999)
    t1 = 1 - sqrt(1 - y0)
    y = lambda t: t * t - 2 * t + y0
    return closed(
        [
            (t1, lambda t: [y(t)], lambda t: [0]),
            (1, lambda t: [0], lambda t: [-y(t)]),
            (None, lambda t: [(t - 1) ** 2], lambda t: [1 - y0]),
        ],
        linspace(0, 3, 32),
        columns(1),
        [(t1, "contact", (0, 0)), (mpf(1), "release", (0, 0))],
    )


@system()
def dip_1e10():
    c = mpf(1.05)
    y0 = mpf(1.05 * 1.05 - 1e-10)
    y = lambda t: t * t - 2 * c * t + y0
    t1 = c - sqrt(c * c - y0)
    return closed(
        [
            (t1, lambda t: [y(t)], lambda t: [0]),
            (c, lambda t: [0], lambda t: [-y(t)]),
            (None, lambda t: [(t - c) ** 2], lambda t: [c * c - y0]),
        ],
        linspace(0, 3, 31),
        columns(1),
        [(t1, "contact", (0, 0)), (c, "release", (0, 0))],
    )


@system()
def near_miss():
    return closed(
        [(None, lambda t: [(t - 1) ** 2 + mpf(1.000000001) - 1], lambda t: [0])],
        linspace(0, 3, 32),
        columns(1),
        [],
    )


@system()
def spike_5e3():
    t0 = mpf(5.003)
    w = mpf(0.005)
    return complementarity(
        lambda t, x: [mpf(0.01) - 34 * exp(-(((t - t0) / w) ** 2))],
        [affine([1])],
        [0.1],
        linspace(0, 10, 21),
        H=lambda t: mpf("0.002") if abs(t - t0) < mpf("0.1") else mpf("0.02"),
    )


@system()
def spike_2d():
    t0 = mpf(6.2137)
    w = mpf(0.005)
    return complementarity(
        lambda t, x: [x[1] * mpf(0.3), -x[1] / 2 - 100 * exp(-(((t - t0) / w) ** 2)) + mpf(0.2)],
        [affine([0.3, 1], mpf(0.1))],
        [0.4, 0.05],
        linspace(0, 10, 11),
        H=lambda t: mpf("0.002") if abs(t - t0) < mpf("0.1") else mpf("0.02"),
    )


@system()
def wall_bump():
    t0 = mpf(3.3)
    w = mpf(0.01)
    b = lambda t: 1 - mpf(1.2) * exp(-(((t - t0) / w) ** 2))
    t1 = t0 - w * sqrt(log(mpf(1.2)))
    return closed(
        [
            (t1, lambda t: [0], lambda t: [0]),
            (t0, lambda t: [-b(t)], lambda t: [-b(t)]),
            (None, lambda t: [mpf(1.2) - 1], lambda t: [mpf(1.2) - 1]),
        ],
        linspace(0, 10, 21),
        columns(1),
        [(t1, "contact", (0, 0)), (t0, "release", (0, 0))],
    )


@system()
def bump_wide():
    b = lambda t: 1 - mpf(1.2) * exp(-(((t - mpf(3.3)) / mpf(0.05)) ** 2))
    return complementarity(
        lambda t, x: [mpf(0.01) * cos(t)],
        [affine([1], b, lambda t: (1 - b(t)) * 2 * (t - mpf(3.3)) / mpf(0.05) ** 2)],
        [0],
        linspace(0, 10, 21),
        H=lambda t: mpf("0.01") if 2.7 < t < 4 else mpf("0.1"),
    )


@system()
def flyby():
    return complementarity(
        lambda t, x: [mpf(0), mpf(0.02)],
        [anchor(0, lambda t: [20 * (t - 5), mpf(0.9)], lambda t: [mpf(20), 0], 1, 2)],
        [0, 0],
        linspace(0, 10, 21),
        H=lambda t: mpf("0.005") if 4.8 < t < 5.2 else mpf("0.1"),
        ids=[(0, 0, 0)],
    )


@system()
def narrow_dip():
    d = sqrt(mpf(2.5e-7))
    t1 = 1 - d
    t2 = t1 + d / 2
    return closed(
        [
            (t1, lambda t: [t], lambda t: [t]),
            (t2, lambda t: [t1 + 4 * (t - t1)], lambda t: [t1]),
            (None, lambda t: [1 + d + t - t2], lambda t: [t1 + t - t2]),
        ],
        linspace(0, 3, 32),
        [(0, 0)],
        [(t1, "cross", (0, 0)), (t2, "cross", (0, 0))],
    )


@system()
def switch_bump():
    d = mpf(0.01) * sqrt(log(mpf(1.2)))
    c = mpf(3.3)
    return closed(
        [
            (c - d, lambda t: [t], lambda t: [t]),
            (c + d, lambda t: [c - d - 200 * (t - c + d)], lambda t: [c - d]),
            (None, lambda t: [t - 402 * d], lambda t: [t - 2 * d]),
        ],
        linspace(0, 10, 21),
        [(0, 0)],
        [(c - d, "cross", (0, 0)), (c + d, "cross", (0, 0))],
    )


@system()
def fil_spike():
    return filippov(
        lambda t, x, s: [3 * exp(-(((t - mpf(4.2137)) / mpf(0.01)) ** 2)) - s[0]],
        lambda t, x: [x[0]],
        const([1]),
        [0.5],
        linspace(0, 8, 9),
        H=lambda t: mpf("0.003") if 4.1 < t < 4.33 else mpf("0.04"),
    )
