"""Inside and outside circles and ellipses, by gradients that are not of length one."""

from engine import linspace, system
from modes import Gap, complementarity, dist
from mpmath import cos, mpf, sin, sqrt


@system()
def in_circle():
    return complementarity(
        lambda t, x: [mpf(1.5) * cos(mpf(0.7) * t), mpf(0.8) * sin(mpf(1.9) * t) - mpf(0.1) * x[1]],
        [Gap(lambda t, x: 1 - x[0] ** 2 - x[1] ** 2, lambda t, x: [-2 * x[0], -2 * x[1]])],
        [0.1, -0.2],
        linspace(0, 15, 61),
        H=0.1,
    )


@system()
def in_ellipse():
    return complementarity(
        lambda t, x: [cos(t) + mpf(0.1) * x[1], -sin(mpf(0.6) * t) - mpf(0.2)],
        [Gap(lambda t, x: 1 - x[0] ** 2 / 4 - x[1] ** 2, lambda t, x: [-x[0] / 2, -2 * x[1]])],
        [-0.5, 0.3],
        linspace(0, 15, 61),
        H=0.1,
    )


@system()
def out_ellipse():
    return complementarity(
        lambda t, x: [mpf(1), -mpf(0.1) * x[1]],
        [Gap(lambda t, x: x[0] ** 2 / 4 + x[1] ** 2 - 1, lambda t, x: [x[0] / 2, 2 * x[1]])],
        [-4.0, 0.05],
        linspace(0, 9, 46),
        H=0.1,
    )


@system()
def ellipse_moving():
    a = lambda t, x: x[0] - mpf(0.3) * sin(2 * t)
    b = lambda t, x: x[1] - mpf(0.2) * cos(t)
    return complementarity(
        lambda t, x: [mpf(0.5) + mpf(0.2) * sin(t), -mpf(0.3) * x[1]],
        [
            Gap(
                lambda t, x: a(t, x) ** 2 / 2 + b(t, x) ** 2 - 1,
                lambda t, x: [a(t, x), 2 * b(t, x)],
                lambda t, x: -a(t, x) * mpf(0.6) * cos(2 * t) + 2 * b(t, x) * mpf(0.2) * sin(t),
            )
        ],
        [-2.5, 0.1],
        linspace(0, 10, 51),
        H=0.05,
    )


@system()
def discs_in_circle():
    def f(t, x):
        return [
            mpf(1.2) * cos(t),
            -mpf(0.8) + mpf(0.2) * x[0],
            mpf(0.9) * cos(mpf(1.4) * t),
            -mpf(0.7) - mpf(0.1) * x[3],
        ]

    z = mpf(0)

    def w(i, R):
        r = lambda x: sqrt(x[2 * i] ** 2 + x[2 * i + 1] ** 2)
        return Gap(
            lambda t, x: R - r(x),
            lambda t, x: [-x[j] / r(x) if j // 2 == i else z for j in range(4)],
        )

    return complementarity(
        f,
        [w(0, mpf(1)), w(1, mpf(0.9)), dist(0, 1, 0.5, 4)],
        [-0.3, 0.2, 0.4, 0.1],
        linspace(0, 9, 46),
        H=0.05,
        ids=[(0, 0), (0, 1), (1, 0, 1)],
    )
