"""Scripts of modes of Filippov systems, written by hand (see hybrid_automaton.py).

Each function builds the script of the case of its name, with the parameters of the case.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from nsbench.case import Case
from nsbench.solvers.solve_ivp.hybrid_automaton import Arc, Exit, Script


def slide_exit(case: Case) -> Script:
    """Script a slide on a line that ends where the field below points away from it."""

    def above(t: float, y: np.ndarray) -> list[float]:
        return [1.0 + y[1], -1.0 - 0.5 * math.sin(y[0]), 1.0]

    def below(t: float, y: np.ndarray) -> list[float]:
        return [2.0 + 0.25 * y[0] * y[0], 1.0 - y[0], 0.0]

    def on(t: float, y: np.ndarray) -> list[float]:
        x = y[0]
        w = (1.0 - x) / (
            2.0 - x + 0.5 * math.sin(x)
        )  # makes w (-1 - sin(x)/2) + (1 - w) (1 - x) vanish
        return [w + (1.0 - w) * (2.0 + 0.25 * x * x), 0.0, w]

    return Script(
        {
            "above": Arc(above, (Exit(lambda t, y: y[1], -1, "on", "enter"),)),
            "on": Arc(on, (Exit(lambda t, y: 1.0 - y[0], -1, "below", "exit"),), _zero(1)),
            "below": Arc(below),
        },
        "above",
    )


def oscillator(case: Case, swapped: bool = False) -> Script:
    """Script an oscillator whose sense of turning changes at the unit circle."""
    turn = 2.0 * math.pi * (-1.0 if swapped else 1.0)
    circle = lambda t, y: y[0] * y[0] + y[1] * y[1] - 1.0
    return Script(
        {
            "inside": Arc(
                lambda t, y: [y[0] - turn * y[1], y[1] + turn * y[0], 0.0],
                (Exit(circle, 1, "outside", "cross"),),
            ),
            "outside": Arc(lambda t, y: [y[0] + turn * y[1], y[1] - turn * y[0], 1.0]),
        },
        "inside",
    )


def stick_slip(case: Case, x0: float = 0.5, T: float = 20.0) -> Script:
    """Script a block on a moving belt with friction that falls with the sliding speed."""
    belt = 0.2
    speed = lambda t, y: y[1] - belt

    def caught(t: float, y: np.ndarray) -> str:
        return "stick" if abs(y[0]) <= 1.0 else "slow" if y[0] > 1.0 else "fast"

    def match(t: float, y: np.ndarray) -> None:
        y[1] = belt

    return Script(
        {
            "slow": Arc(
                lambda t, y: [y[1], -y[0] + 1.0 / (1.2 - y[1]), 0.0],
                (Exit(speed, 1, caught, "enter"),),
            ),
            "fast": Arc(
                lambda t, y: [y[1], -y[0] - 1.0 / (0.8 + y[1]), 1.0],
                (Exit(speed, -1, caught, "enter"),),
            ),
            "stick": Arc(
                lambda t, y: [belt, 0.0, 0.5 * (1.0 - y[0])],
                (Exit(lambda t, y: 1.0 - y[0], -1, "slow", "exit"),),
                match,
            ),
        },
        "slow",
    )


def friction(case: Case, mu: float = 0.3, x0: float = 1.0) -> Script:
    """Script an oscillator with dry friction mu, which stops within |x| <= mu."""

    def turned(other: str) -> Callable:
        return lambda t, y: "stuck" if abs(y[0]) <= mu else other

    v = lambda t, y: y[1]
    left = turned("right")
    right = turned("left")
    first = "stuck" if abs(x0) <= mu else "left" if x0 > 0.0 else "right"
    return Script(
        {
            "left": Arc(
                lambda t, y: [y[1], mu - y[0], 0.0], (Exit(v, 1, left, _stops(left)),), _zero(1)
            ),
            "right": Arc(
                lambda t, y: [y[1], -mu - y[0], 1.0], (Exit(v, -1, right, _stops(right)),), _zero(1)
            ),
            "stuck": Arc(lambda t, y: [0.0, 0.0, 0.5 * (1.0 - y[0] / mu)], (), _zero(1)),
        },
        first,
    )


def _stops(next_of):
    """Return the kind of event: "enter" if the velocity stays zero, else "cross"."""
    return lambda t, y: "enter" if next_of(t, y) == "stuck" else "cross"


def circle_sliding(
    case: Case, a: float = 0.5, outside: float = 1.5, inside: float = 0.5, r0: float = 1.5
) -> Script:
    """Script a slide on the unit circle from a start outside or inside."""
    u = 0.5 * (outside + inside)
    v = 0.5 * (outside - inside)
    circle = lambda t, y: y[0] * y[0] + y[1] * y[1] - 1.0

    def field(t: float, y: np.ndarray, s: float) -> list[float]:
        grow = a * math.sin(t) - s
        turn = u + v * s
        return [grow * y[0] - turn * y[1], grow * y[1] + turn * y[0], 0.5 * (1.0 + s)]

    return Script(
        {
            "outside": Arc(lambda t, y: field(t, y, 1.0), (Exit(circle, -1, "on", "enter"),)),
            "inside": Arc(lambda t, y: field(t, y, -1.0), (Exit(circle, 1, "on", "enter"),)),
            "on": Arc(lambda t, y: field(t, y, a * math.sin(t))),
        },
        "outside" if r0 > 1.0 else "inside",
    )


def two_surfaces(case: Case, kind: str = "affine") -> Script | None:
    """Script a slide on one line, then at the corner of two; None for kinds other than "affine"."""
    if kind != "affine":
        return None
    k = 0.4
    a = 0.3

    def field(t: float, s1: float, s2: float) -> list[float]:
        return [
            a * math.sin(t) - s1 + k * s2,
            a * math.cos(t) - k * s1 - s2,
            1.0 + s1 - 0.5 * s2,
            0.5 * (1.0 + s1),
            0.5 * (1.0 + s2),
        ]

    def line(t: float, y: np.ndarray) -> list[float]:
        return field(t, 1.0, a * math.cos(t) - k)

    def corner(t: float, y: np.ndarray) -> list[float]:
        p = a * math.sin(t)
        q = a * math.cos(t)
        return field(t, (p + k * q) / (1.0 + k * k), (q - k * p) / (1.0 + k * k))

    return Script(
        {
            "free": Arc(
                lambda t, y: field(t, 1.0, 1.0),
                (Exit(lambda t, y: y[1], -1, "line", "enter", (0, 1)),),
            ),
            "line": Arc(line, (Exit(lambda t, y: y[0], -1, "corner", "enter"),), _zero(1)),
            "corner": Arc(corner, (), _zero(0)),
        },
        "free",
        ((0, 0), (0, 1)),
    )


def sliding(case: Case) -> Script:
    """Script constant fields that meet a line and slide on it."""
    return Script(
        {
            "above": Arc(
                lambda t, y: [1.0, -1.0, 1.0], (Exit(lambda t, y: y[1], -1, "on", "enter"),)
            ),
            "on": Arc(lambda t, y: [1.5, 0.0, 0.5], (), _zero(1)),
        },
        "above",
    )


def crossing(case: Case) -> Script:
    """Script constant fields that cross a line."""
    return Script(
        {
            "above": Arc(
                lambda t, y: [1.0, -1.0, 1.0], (Exit(lambda t, y: y[1], -1, "below", "cross"),)
            ),
            "below": Arc(lambda t, y: [2.0, -3.0, 0.0]),
        },
        "above",
    )


def apple_filippov(case: Case, y0: float = 1.0) -> Script:
    """Script a fall onto the floor, as a Filippov system."""
    return Script(
        {
            "fall": Arc(lambda t, y: [-1.0, 1.0], (Exit(lambda t, y: y[0], -1, "rest", "enter"),)),
            "rest": Arc(lambda t, y: [0.0, 0.0]),
        },
        "fall" if y0 > 0.0 else "rest",
    )


def _zero(i):
    """Return a function that sets coordinate i of the state to zero, in place."""

    def enter(t: float, y: np.ndarray) -> None:
        y[i] = 0.0

    return enter


SCRIPTS = {
    "slide_exit": slide_exit,
    "oscillator": oscillator,
    "stick_slip": stick_slip,
    "friction": friction,
    "circle_sliding": circle_sliding,
    "two_surfaces": two_surfaces,
    "sliding": sliding,
    "crossing": crossing,
    "apple_filippov": apple_filippov,
}
