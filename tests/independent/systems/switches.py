"""Filippov systems: crossings, sliding, friction, surfaces that meet."""

from engine import closed, linspace, system
from modes import const, filippov
from mpmath import cos, mpf, pi, sin, sqrt


def modes1(above, below):
    """One field per side of one surface."""

    def f(t, x, s):
        w = (1 + s[0]) / 2
        return [w * p + (1 - w) * q for p, q in zip(above(t, x), below(t, x), strict=True)]

    return f


@system()
def surf_moving():
    return filippov(
        modes1(lambda t, x: [mpf(-1.5)], lambda t, x: [mpf(1.5)]),
        lambda t, x: [x[0] - sin(t)],
        lambda t, x: ([[mpf(1)]], [-cos(t)]),
        [1.0],
        linspace(0, 10, 41),
        H=0.1,
    )


@system()
def surf_exits():
    return filippov(
        lambda t, x, s: [mpf(0.1) * sin(t) - mpf(0.8) * s[0]],
        lambda t, x: [x[0] - sin(t)],
        lambda t, x: ([[mpf(1)]], [-cos(t)]),
        [1.0],
        linspace(0, 20, 81),
        H=0.1,
    )


@system()
def cross_many():
    return filippov(
        modes1(
            lambda t, x: [x[1], -x[0] - mpf(0.3)], lambda t, x: [x[1], -mpf(1.7) * x[0] + mpf(0.3)]
        ),
        lambda t, x: [x[0] + mpf(0.2)],
        const([1, 0]),
        [1, 0],
        linspace(0, 40, 81),
        H=0.2,
    )


@system()
def circle_slide():
    def f(t, x, s):
        e = mpf(0.8) * cos(t) - s[0] / 2
        w = mpf(0.9)
        return [w * x[1] + e * x[0], -w * x[0] + e * x[1]]

    return filippov(
        f,
        lambda t, x: [x[0] ** 2 + x[1] ** 2 - 1],
        lambda t, x: ([[2 * x[0], 2 * x[1]]], [mpf(0)]),
        [0.5, 0.1],
        linspace(0, 15, 61),
        H=0.1,
    )


@system()
def sphere_slide():
    c3 = mpf(0.3)

    def f(t, x, s):
        return [
            x[1] - s[0] * x[0],
            -x[0] + c3 * x[2] - s[0] * x[1],
            -c3 * x[1] - s[0] * x[2] - mpf(0.4) - mpf(1.1) * cos(mpf(1.3) * t),
        ]

    r = lambda x: sqrt(x[0] ** 2 + x[1] ** 2 + x[2] ** 2)
    return filippov(
        f,
        lambda t, x: [r(x) - 1],
        lambda t, x: ([[v / r(x) for v in x]], [mpf(0)]),
        [0.3, 0.2, 1.5],
        linspace(0, 12, 49),
        H=0.1,
    )


@system()
def two_simul():
    return filippov(
        lambda t, x, s: [
            mpf(1.5) * sin(t) - s[0],
            mpf(1.5) * sin(t) + mpf(0.2) * (x[0] - x[1]) - s[1],
        ],
        lambda t, x: [x[0], x[1]],
        const([1, 0], [0, 1]),
        [1, 1],
        linspace(0, 9, 46),
        d=2,
        H=0.1,
    )


@system()
def codim2_relay():
    return filippov(
        lambda t, x, s: [
            mpf(0.4) * cos(t) - s[0] - s[1] / 2,
            mpf(0.3) * sin(2 * t) + s[0] / 2 - s[1],
        ],
        lambda t, x: [x[0], x[1]],
        const([1, 0], [0, 1]),
        [0.8, 0.9],
        linspace(0, 8, 41),
        d=2,
        H=0.1,
    )


@system()
def codim2_leave():
    return filippov(
        lambda t, x, s: [
            mpf(1.3) * cos(t) - s[0] - mpf(0.2) * s[1],
            mpf(1.2) * sin(mpf(1.7) * t) + mpf(0.3) * s[0] - s[1],
        ],
        lambda t, x: [x[0], x[1] - mpf(0.2) * x[0]],
        const([1, 0], [mpf(-0.2), 1]),
        [0.3, 0.9],
        linspace(0, 10, 51),
        d=2,
        H=0.1,
    )


@system(optional=(0,))
def dry_friction():
    """Half-cosines, which end at multiples of pi."""
    path = filippov(
        lambda t, x, s: [x[1], -x[0] - s[0] / 2],
        lambda t, x: [x[1]],
        const([0, 1]),
        [3.3, 0],
        linspace(0, 12, 49),
        H=0.2,
    )
    for k, e in enumerate(path.events):
        assert abs(e[0] - (k + 1) * pi) < mpf(10) ** -28
    return path


@system()
def friction_forced():
    return filippov(
        lambda t, x, s: [
            x[1],
            -x[0] - mpf(0.2) * x[1] + mpf(1.5) * cos(mpf(0.7) * t) - mpf(0.6) * s[0],
        ],
        lambda t, x: [x[1]],
        const([0, 1]),
        [1, 0.5],
        linspace(0, 30, 121),
        H=0.2,
    )


@system()
def belt():
    return filippov(
        lambda t, x, s: [x[1], -x[0] - s[0] + mpf(0.2) * (x[1] - mpf(0.5))],
        lambda t, x: [x[1] - mpf(0.5)],
        const([0, 1]),
        [0, 0],
        linspace(0, 30, 61),
        H=0.2,
    )


@system(events="none")
def touch_surface():
    return closed(
        [(None, lambda t: [(t - 1) ** 2, t], lambda t: [t])], linspace(0, 3, 31), [(0, 0)], []
    )


@system(optional=(0,))
def start_slide():
    return filippov(
        lambda t, x, s: [1 + mpf(0.3) * s[0], mpf(0.4) * t - s[0]],
        lambda t, x: [x[1]],
        const([0, 1]),
        [0, 0],
        linspace(0, 5, 26),
        H=0.1,
    )


@system()
def periodic():
    a = mpf(0.2)
    return filippov(
        modes1(
            lambda t, x: [x[1] + a, -1 + mpf(1.6) * sin(t) * cos(mpf(0.4) * t) - a * x[0]],
            lambda t, x: [x[1] - a, 1 + mpf(1.6) * sin(t) - a * x[0]],
        ),
        lambda t, x: [x[1] + mpf(0.1) * x[0]],
        const([mpf(0.1), 1]),
        [0.5, 1],
        linspace(0, 20, 81),
        H=0.1,
    )


@system()
def three_surf():
    def f(t, x, s):
        return [
            -s[0] + mpf(0.3) * x[1] + sin(t) / 2,
            -mpf(1.2) * s[1] - mpf(0.4) * x[2] + mpf(1.6) * cos(mpf(1.1) * t),
            -mpf(0.8) * s[2] + mpf(0.2) * s[0] + mpf(0.9) * sin(mpf(0.7) * t),
        ]

    return filippov(
        f,
        lambda t, x: [x[0], x[1], x[2] - mpf(0.3) * x[0]],
        const([1, 0, 0], [0, 1, 0], [mpf(-0.3), 0, 1]),
        [0.7, 0.5, -0.6],
        linspace(0, 10, 51),
        d=3,
        H=0.1,
    )


@system()
def same_field():
    g = lambda t, x: [-sin(2 * t) - mpf(0.1) * x[0]]
    return filippov(
        modes1(g, g), lambda t, x: [x[0] - mpf(0.4)], const([1]), [1], linspace(0, 12, 49), H=0.1
    )


@system()
def lotka_refuge():
    return filippov(
        modes1(
            lambda t, x: [x[0] * (1 - x[1]), x[1] * (x[0] - mpf(1.8))],
            lambda t, x: [x[0] * (1 - x[1]), x[1] * (x[0] - 1)],
        ),
        lambda t, x: [x[1] - mpf(1.2)],
        const([0, 1]),
        [0.5, 0.8],
        linspace(0, 25, 101),
        H=0.1,
    )


@system()
def modes4():
    M = {
        (1, 1): lambda t, x: [-1 + mpf(0.3) * x[1], -mpf(0.7)],
        (1, -1): lambda t, x: [-mpf(0.8), mpf(0.9) + mpf(0.2) * sin(t)],
        (-1, 1): lambda t, x: [mpf(0.7) + cos(t) / 2, -mpf(1.1)],
        (-1, -1): lambda t, x: [mpf(1.2), mpf(0.6) - mpf(0.1) * x[0]],
    }

    def f(t, x, s):
        o = [mpf(0), mpf(0)]
        for k, g in M.items():
            w = (1 + k[0] * s[0]) * (1 + k[1] * s[1]) / 4
            v = g(t, x)
            o = [o[0] + w * v[0], o[1] + w * v[1]]
        return o

    return filippov(
        f,
        lambda t, x: [x[0] - mpf(0.1) * x[1], x[1] - sin(t / 2) / 2],
        lambda t, x: ([[mpf(1), -mpf(0.1)], [mpf(0), mpf(1)]], [mpf(0), -cos(t / 2) / 4]),
        [0.6, 1],
        linspace(0, 10, 51),
        d=2,
        H=0.1,
    )


@system()
def ray_fast():
    return filippov(
        lambda t, x, s: [mpf(1), 150 * sin(t) + 30 * x[0] - 200 * s[0]],
        lambda t, x: [x[1] - mpf(0.1) * x[0]],
        const([mpf(-0.1), 1]),
        [0, 1],
        linspace(0, 3, 31),
        H=0.05,
    )
