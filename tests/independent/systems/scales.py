"""Stiff, slow, long, small, far off and steep."""

from engine import closed, columns, linspace, system
from modes import affine, complementarity, eye
from mpmath import cos, exp, findroot, mpf, pi, sin


@system()
def stiff():
    """Closed: p solves y' = -k (y - cos t)."""
    k = mpf(10) ** 4
    p = lambda t: (k * k * cos(t) + k * sin(t)) / (k * k + 1)
    y1 = lambda t: p(t) + (1 - p(mpf(0))) * exp(-k * t)
    t1 = findroot(y1, pi / 2 + 1 / k)
    t2 = 3 * pi / 2
    y3 = lambda t: p(t) - p(t2) * exp(-k * (t - t2))
    t3 = findroot(y3, 5 * pi / 2 + 1 / k)
    imp = lambda t: k * (sin(t1) - sin(t))
    return closed(
        [
            (t1, lambda t: [y1(t)], lambda t: [0]),
            (t2, lambda t: [0], lambda t: [imp(t)]),
            (t3, lambda t: [y3(t)], lambda t: [imp(t2)]),
            (None, lambda t: [0], lambda t: [imp(t2) + k * (sin(t3) - sin(t))]),
        ],
        linspace(0, 8, 41),
        columns(1),
        [(t1, "contact", (0, 0)), (t2, "release", (0, 0)), (t3, "contact", (0, 0))],
    )


@system()
def long_T():
    return complementarity(
        lambda t, x: [cos(mpf(0.05) * t) - mpf(0.1) + mpf(0.05) * sin(mpf(0.31) * t)],
        [affine([1])],
        [3.0],
        linspace(0, 1000, 201),
        H=1.0,
    )


@system()
def tiny():
    return complementarity(
        lambda t, x: [-mpf(4e-3) * cos(6000 * t) - mpf(1e-3), mpf(1e-3) - 200 * x[1] + 4000 * x[0]],
        [affine([1, 0]), affine([0, -1], mpf(2e-6))],
        [0.4e-6, 0.5e-6],
        linspace(0, 1e-3, 41),
        H=1e-5,
    )


@system()
def offset_1e6():
    return complementarity(
        lambda t, x: [-cos(t)], [affine([1], mpf(-1e6))], [1e6 + 0.5], linspace(0, 7, 36), H=0.1
    )


@system()
def offset_scaled():
    return complementarity(
        lambda t, x: [-cos(t), -sin(t)],
        [affine([1e3, 0]), affine([0, 1e-3], mpf(5e-4))],
        [0.5, 0.2],
        linspace(0, 8, 41),
        H=0.1,
    )


@system()
def exp_growth():
    return complementarity(
        lambda t, x: [x[0] + sin(3 * t) - exp(-mpf(0.1) * t) / 2, -x[1] + mpf(0.01) * x[0]],
        eye(2),
        [0.1, 0.3],
        linspace(0, 7, 36),
        H=0.05,
    )


@system()
def slow_passage():
    return complementarity(
        lambda t, x: [-mpf(1e-3) - mpf(0.1) * (t - 2) ** 2, -mpf(1e-3) * cos(mpf(0.3) * t)],
        eye(2),
        [2e-3 + 0.8 / 3.0, 2.5e-3],
        linspace(0, 20, 41),
        H=0.1,
    )
