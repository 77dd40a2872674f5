"""Filippov systems with closed forms, made to be hard on event location; written without any code
of the package's.

Each function returns (problem, x0, T, x(t) -> (k, n), integrals of theta (k, d), events as (time,
kind, surface)).
"""

import numpy as np
from filippov_factories import constant, drift, entry, root, stack, states
from filippov_friction import belt_crossed_then_caught, belt_that_is_touched, forced
from scipy.integrate import quad

from nsbench import Filippov


def moving_line():
    """Caught by x2 = sin t + 0.3 x1, which moves."""
    problem = Filippov.signs(
        drift(lambda xp, t, x, s: xp.array([1.0 + 0 * s[0], -3 * s[0]])),
        drift(lambda xp, t, x: x[1:2] - xp.sin(t) - 0.3 * x[0:1]),
    )
    g = lambda t: np.sin(t) + 0.3 * t
    t1 = root(lambda t: 1 - 3 * t - g(t), 0, 1)

    def w(t):
        u = np.maximum(t, t1)
        return (np.minimum(t, t1) + 0.5 * (u - t1) - (g(u) - g(t1)) / 6)[:, None]

    return (
        problem,
        (0.0, 1.0),
        6.0,
        lambda t: stack(t, np.where(t < t1, 1 - 3 * t, g(t))),
        w,
        [(t1, "enter", 0)],
    )


def moving_parabola():
    """Caught by x2 = x1^2 + sin(2t)/2 and left behind by it where it rises too fast."""
    problem = Filippov.signs(
        drift(lambda xp, t, x, s: xp.array([1.0 + 0 * s[0], -8 * s[0]])),
        drift(lambda xp, t, x: x[1:2] - x[0:1] ** 2 - 0.5 * xp.sin(2 * t)),
    )
    g = lambda t: t * t + 0.5 * np.sin(2 * t)
    t1 = root(lambda t: 1 - 8 * t - g(t), 0, 1)
    t2 = root(lambda t: 2 * t + np.cos(2 * t) - 8, 3, 5)
    x = lambda t: stack(
        t, np.where(t < t1, 1 - 8 * t, np.where(t < t2, g(t), g(t2) + 8 * (t - t2)))
    )

    def w(t):
        u = np.clip(t, t1, t2)
        return (np.minimum(t, t1) + 0.5 * (u - t1) - (g(u) - g(t1)) / 16)[:, None]

    return problem, (0.0, 1.0), 4.5, x, w, [(t1, "enter", 0), (t2, "exit", 0)]


def entry_at_full_weight():
    """Arrives where the far field is tangential and turns against it: slides from theta = 1 on."""
    problem = Filippov({(1,): drift(lambda xp, t, x: 1 - t + 0 * x), (-1,): constant(1.0)}, states)
    return (
        problem,
        (-1.0,),
        3.0,
        lambda t: np.minimum(t - 1, 0)[:, None],
        lambda t: np.log(np.maximum(t, 1))[:, None],
        [(1.0, "enter", 0)],
    )


def crossing_at_full_weight():
    """Arrives where the far field is tangential and turns away: leaves on a parabola."""
    problem = Filippov({(1,): drift(lambda xp, t, x: t - 1 + 0 * x), (-1,): constant(1.0)}, states)
    return (
        problem,
        (-1.0,),
        3.0,
        lambda t: np.where(t < 1, t - 1, (t - 1) ** 2 / 2)[:, None],
        lambda t: np.maximum(t - 1, 0)[:, None],
        [(1.0, "cross", 0)],
    )


def weight_that_touches_zero():
    """The lower field all but stops pushing at t = 1.3: the point stays."""
    problem = Filippov(
        {(1,): constant(-1.0), (-1,): drift(lambda xp, t, x: (t - 1.3) ** 2 + 0 * x)}, states
    )
    F = lambda u: u - np.arctan(u)
    return (
        problem,
        (0.0,),
        3.0,
        lambda t: np.zeros((len(t), 1)),
        lambda t: (F(t - 1.3) - F(-1.3))[:, None],
        [],
    )


def exit_by_a_cube():
    """theta falls to zero as a cube: leaves on a curve of order four."""
    problem = Filippov(
        {(1,): constant(-1.0), (-1,): drift(lambda xp, t, x: -((t - 1.3) ** 3) + 0 * x)}, states
    )
    part = lambda t: quad(
        lambda u: (1.3 - u) ** 3 / (1 + (1.3 - u) ** 3), 0, min(t, 1.3), epsabs=1e-14
    )[0]
    return (
        problem,
        (0.0,),
        3.0,
        lambda t: np.where(t < 1.3, 0, -((t - 1.3) ** 4) / 4)[:, None],
        lambda t: np.array([part(s) for s in t])[:, None],
        [(1.3, "exit", 0)],
    )


def graze():
    """Touches the line at t = 1 from above, where the lower field pushes up: no event."""
    problem = Filippov(
        {(1,): drift(lambda xp, t, x: xp.array([1.0, 2 * x[0]])), (-1,): constant(1.0, 1.0)},
        entry(1),
    )
    return problem, (-1.0, 1.0), 2.0, lambda t: stack(t - 1, (t - 1) ** 2), lambda t: t[:, None], []


def left_and_met_again():
    """Slides, is let down, comes back, slides and is let go: x1' = 1, lower field cos t + 0.2,
    upper -1."""
    problem = Filippov(
        {
            (1,): constant(1.0, -1.0),
            (-1,): drift(lambda xp, t, x: xp.array([1.0, xp.cos(t) + 0.2])),
        },
        entry(1),
    )
    a = np.arccos(-0.2)
    h = lambda t: np.sin(t) - np.sin(a) + 0.2 * (t - a)
    b = root(h, a + 1, 7)
    c = 2 * np.pi + a
    rate = lambda t: (np.cos(t) + 0.2) / (1.2 + np.cos(t))
    weight = lambda t: sum(
        quad(rate, p, q, epsabs=1e-14)[0] for p, q in ((0, min(t, a)), (b, min(t, c))) if q > p
    )
    x = lambda t: stack(
        t, np.select([t < a, t < b, t < c], [0, h(t), 0], np.sin(t) - np.sin(c) + 0.2 * (t - c))
    )
    return (
        problem,
        (0.0, 0.0),
        11.0,
        x,
        lambda t: np.array([weight(s) for s in t])[:, None],
        [(a, "exit", 0), (b, "enter", 0), (c, "exit", 0)],
    )


def bouncing_relay():
    """x'' = -sgn x: parabolas from zero to zero, period 4 sqrt 2."""
    q = np.sqrt(2.0)
    problem = Filippov.relay(
        drift(lambda xp, t, x: xp.array([x[1], 0.0])), np.array([[0.0], [-1.0]]), entry(0)
    )

    def x(t):
        k = np.floor((t + q) / (2 * q))
        r = t - 2 * q * k
        sign = (-1.0) ** k
        return stack(sign * (1 - r * r / 2), -sign * r)

    def w(t):
        k = np.floor((t + q) / (4 * q))
        return (np.minimum(t + q - 4 * q * k, 2 * q) + 2 * q * k - q)[:, None]

    return problem, (1.0, 0.0), 20.0, x, w, [(q * (2 * k + 1), "cross", 0) for k in range(7)]


def talk(scale=1.0, switch=1.0, lift=0.0):
    """The talk's two fields, with lengths or the switch function in other units, or the line at
    height `lift`."""
    problem = Filippov(
        {(1,): constant(scale, -scale), (-1,): constant(2 * scale, scale)},
        drift(lambda xp, t, x: switch * (x[1:2] - lift)),
    )
    x = lambda t: (
        scale * stack(np.where(t < 0.5, t, 1.5 * t - 0.25), np.maximum(0.5 - t, 0))
        + np.array([0, lift])
    )
    return (
        problem,
        (0.0, lift + 0.5 * scale),
        2.0,
        x,
        lambda t: np.where(t < 0.5, t, 0.25 + 0.5 * t)[:, None],
        [(0.5, "enter", 0)],
    )


def fast_relaxation():
    """One coordinate relaxes fifty times faster than the other slides."""
    k = 50.0
    problem = Filippov.signs(
        drift(lambda xp, t, x, s: xp.array([-k * (x[0] - xp.cos(t)), -2 * s[0] + x[0]])), entry(1)
    )
    u = lambda t: (k * k * np.cos(t) + k * np.sin(t) - k * k * np.exp(-k * t)) / (k * k + 1)
    U = lambda t: (k * k * np.sin(t) - k * np.cos(t) + k - k * (1 - np.exp(-k * t))) / (k * k + 1)
    t1 = root(lambda t: 1 - 2 * t + U(t), 0.1, 3)

    def w(t):
        late = np.maximum(t, t1)
        return (np.minimum(t, t1) + 0.5 * (late - t1) + 0.25 * (U(late) - U(t1)))[:, None]

    return (
        problem,
        (0.0, 1.0),
        4.0,
        lambda t: stack(u(t), np.where(t < t1, 1 - 2 * t + U(t), 0)),
        w,
        [(t1, "enter", 0)],
    )


def crossing_one_field():
    """A turning motion that passes a line which does not switch."""
    turn = drift(lambda xp, t, x: xp.array([-x[1], x[0]]))

    def w(t):
        k = np.floor(t / np.pi)
        return (np.ceil(k / 2) * np.pi + np.where(k % 2 == 0, t - k * np.pi, 0))[:, None]

    return (
        Filippov({(1,): turn, (-1,): turn}, entry(1)),
        (1.0, 0.0),
        14.0,
        lambda t: stack(np.cos(t), np.sin(t)),
        w,
        [(np.pi * k, "cross", 0) for k in (1, 2, 3, 4)],
    )


ONE = {
    f.__name__: f
    for f in (
        belt_that_is_touched,
        belt_crossed_then_caught,
        moving_line,
        moving_parabola,
        entry_at_full_weight,
        crossing_at_full_weight,
        weight_that_touches_zero,
        exit_by_a_cube,
        graze,
        left_and_met_again,
        bouncing_relay,
        fast_relaxation,
        crossing_one_field,
    )
}


ONE |= {
    f"forced_{a}_{kind}": lambda kind=kind, a=a: forced(kind, a)
    for a in (1.2, 1.7, 3.0)
    for kind in ("relay", "signs", "modes")
}


ONE |= {
    "starts_stuck": lambda: forced("relay", 1.5, 0.0, 12.0),
    "small": lambda: talk(scale=1e-6),
    "steep": lambda: talk(switch=1e8),
    "flat": lambda: talk(switch=1e-8),
    "far": lambda: talk(lift=1000.0),
}
