"""Scripts of modes of points with constraints, written by hand (see hybrid_automaton.py).

Each function builds the script of the case of its name, with the parameters of the case.
"""

from __future__ import annotations

import math

import numpy as np

from nsbench.case import Case
from nsbench.solvers.solve_ivp.hybrid_automaton import Arc, Exit, Script

UP = np.eye(1)


def apple(case: Case) -> Script:
    """Script a fall with speed 1 onto the floor, and rest there."""
    return Script(
        {
            "fall": Arc(
                lambda t, y: [-1.0, 0.0], (Exit(lambda t, y: y[0], -1, "rest", "contact"),)
            ),
            "rest": Arc(lambda t, y: [0.0, 1.0]),
        },
        "fall",
        push=UP,
    )


def tide(case: Case) -> Script:
    """Script a drift -cos(t) against a floor: contact and release alternate."""
    cos = math.cos
    return Script(
        {
            "free": Arc(
                lambda t, y: [-cos(t), 0.0], (Exit(lambda t, y: y[0], -1, "held", "contact"),)
            ),
            "held": Arc(
                lambda t, y: [0.0, cos(t)],
                (Exit(lambda t, y: cos(t), -1, "free", "release"),),
                _floor,
            ),
        },
        "free",
        push=UP,
    )


def moving_floor(case: Case, a: float = 1.5, b: float = 1.0) -> Script:
    """Script a fall with speed b onto a floor at a sin(t)."""
    sin = math.sin
    cos = math.cos

    def land(t: float, y: np.ndarray) -> None:
        y[0] = a * sin(t)

    return Script(
        {
            "air": Arc(
                lambda t, y: [-b, 0.0],
                (Exit(lambda t, y: y[0] - a * sin(t), -1, "floor", "contact"),),
            ),
            "floor": Arc(
                lambda t, y: [a * cos(t), b + a * cos(t)],
                (Exit(lambda t, y: b + a * cos(t), -1, "air", "release"),),
                land,
            ),
        },
        "air",
        push=UP,
    )


def stiff_contact(case: Case, K: float = 100.0) -> Script:
    """Script a spring of rate K that drags a point along cos t, into the floor and off it."""
    sin = math.sin
    cos = math.cos
    held = lambda t, y: sin(t) - K * cos(t)
    return Script(
        {
            "free": Arc(
                lambda t, y: [-K * (y[0] - cos(t)) - sin(t), 0.0],
                (Exit(lambda t, y: y[0], -1, "held", "contact"),),
            ),
            "held": Arc(
                lambda t, y: [0.0, held(t, y)], (Exit(held, -1, "free", "release"),), _floor
            ),
        },
        "free",
        push=UP,
    )


def play(case: Case) -> Script:
    """Script a point without a drift that two jaws push to and fro."""
    r = 0.35
    w = 2.0**0.5
    u = lambda t: math.sin(t) + math.sin(w * t) / 3.0
    speed = lambda t, y=None: math.cos(t) + w / 3.0 * math.cos(w * t)
    low = Exit(lambda t, y: y[0] - (u(t) - r), -1, "low", "contact", (0, 0))
    high = Exit(lambda t, y: (u(t) + r) - y[0], -1, "high", "contact", (0, 1))
    return Script(
        {
            "rest": Arc(lambda t, y: [0.0, 0.0, 0.0], (low, high)),
            "low": Arc(
                lambda t, y: [speed(t), speed(t), 0.0],
                (Exit(speed, -1, "rest", "release", (0, 0)),),
            ),
            "high": Arc(
                lambda t, y: [speed(t), 0.0, -speed(t)],
                (Exit(speed, 1, "rest", "release", (0, 1)),),
            ),
        },
        "rest",
        ((0, 0), (0, 1)),
        np.array([[1.0], [-1.0]]),
        max_step=0.1,
    )  # a point at rest: no step is too long


def graze(case: Case, delta: float = 0.0) -> Script:
    """Script a parabola that dips into a floor (delta < 0), touches it or misses it."""

    def land(t: float, y: np.ndarray) -> None:
        y[1] = 0.0

    # a dip of length sqrt(-delta) hides between the ends of a step: who expects one bounds the step
    step = 0.25 * math.sqrt(-delta) if delta < 0.0 else math.inf
    return Script(
        {
            "free": Arc(
                lambda t, y: [1.0, 2.0 * y[0], 0.0],
                (
                    Exit(
                        lambda t, y: y[1],
                        -1,
                        lambda t, y: "held" if y[0] < 0.0 else "free",
                        "contact",
                    ),
                ),
            ),
            "held": Arc(
                lambda t, y: [1.0, 0.0, -2.0 * y[0]],
                (Exit(lambda t, y: y[0], 1, "free", "release"),),
                land,
            ),
        },
        "free",
        push=np.array([[0.0, 1.0]]),
        max_step=step,
    )


def wedge(case: Case, psi: float = 60.0, swell: float = 0.0) -> Script:
    """Script a fall into a wedge of two walls with the angle psi (degrees): wall, then corner.

    The drift is 1 + swell sin(t) times a constant.
    """
    c = math.cos(math.radians(psi))
    half = math.radians(psi) / 2
    # of the walls: (nx, ny) and (-nx, ny)
    nx = math.cos(half)
    ny = math.sin(half)
    one = 1.0
    two = 1.0 - 0.3 * (1.0 - c)
    size = math.hypot((one - two) * nx, (one + two) * ny)
    one = one / size
    two = two / size
    px = (two - one) * nx
    py = -(one + two) * ny
    lam = -(px * nx + py * ny)

    def free(t: float, y: np.ndarray) -> list[float]:
        s = 1.0 + swell * math.sin(t)
        return [px * s, py * s, 0.0, 0.0]

    def wall(t: float, y: np.ndarray) -> list[float]:
        s = 1.0 + swell * math.sin(t)
        return [(px + lam * nx) * s, (py + lam * ny) * s, lam * s, 0.0]

    def corner(t: float, y: np.ndarray) -> list[float]:
        s = 1.0 + swell * math.sin(t)
        return [0.0, 0.0, one * s, two * s]

    return Script(
        {
            "free": Arc(free, (Exit(lambda t, y: nx * y[0] + ny * y[1], -1, "wall", "contact"),)),
            "wall": Arc(
                wall, (Exit(lambda t, y: ny * y[1] - nx * y[0], -1, "corner", "contact", (0, 1)),)
            ),
            "corner": Arc(corner),
        },
        "free",
        ((0, 0), (0, 1)),
        np.array([[nx, ny], [-nx, ny]]),
    )


def box_turning(case: Case, side: float = 1.0) -> Script:
    """Script a turning drift in a box with sides of length `side`: nine arcs.

    Each coordinate is free, at its low or at its high stop, whatever the other one does. In the
    unit box one coordinate reaches a stop as the other leaves one: two events, one after the other
    at the same time.
    """
    winds = (math.cos, math.sin)

    def arc(places: tuple[str, str]) -> Arc:
        def rhs(t: float, y: np.ndarray) -> list[float]:
            rate = [0.0] * 6
            for k, place in enumerate(places):
                blow = winds[k](t)
                if place == "free":
                    rate[k] = blow
                else:
                    rate[2 + 2 * k + (place == "high")] = abs(blow)
            return rate

        def enter(t: float, y: np.ndarray) -> None:
            for k, place in enumerate(places):
                if place != "free":
                    y[k] = 0.0 if place == "low" else side

        def go(k: int, place: str) -> str:
            return " ".join(place if i == k else p for i, p in enumerate(places))

        exits = []
        for k, place in enumerate(places):
            if place == "free":
                exits += [
                    Exit(lambda t, y, k=k: y[k], -1, go(k, "low"), "contact", (0, 2 * k)),
                    Exit(
                        lambda t, y, k=k: side - y[k], -1, go(k, "high"), "contact", (0, 2 * k + 1)
                    ),
                ]
            else:
                exits.append(
                    Exit(
                        lambda t, y, k=k: winds[k](t),
                        1 if place == "low" else -1,
                        go(k, "free"),
                        "release",
                        (0, 2 * k + (place == "high")),
                    )
                )
        return Arc(rhs, tuple(exits), enter)

    places = ("free", "low", "high")
    walls = np.repeat(np.eye(2), 2, axis=0) * np.array([[1.0], [-1.0], [1.0], [-1.0]])
    return Script(
        {f"{a} {b}": arc((a, b)) for a in places for b in places},
        "free free",
        ((0, 0), (0, 1), (0, 2), (0, 3)),
        walls,
    )


def obstacle(case: Case, b: float = 0.2) -> Script:
    """Script a straight flight against a round pillar, around it and off it."""

    def pillar(t: float, y: np.ndarray) -> list[float]:
        r = math.hypot(y[0], y[1])
        c = y[0] / r
        s = y[1] / r
        return [1.0 - c * c, -c * s, -c, -c * c, -c * s]

    return Script(
        {
            "free": Arc(
                lambda t, y: [1.0, 0.0, 0.0, 0.0, 0.0],
                (
                    Exit(
                        lambda t, y: math.hypot(y[0], y[1]) - 1.0,
                        -1,
                        "pillar",
                        "contact",
                        (0, 0, 0),
                    ),
                ),
            ),
            "pillar": Arc(pillar, (Exit(lambda t, y: y[0], 1, "free", "release", (0, 0, 0)),)),
        },
        "free",
        ((0, 0, 0),),
        None,
        max_step=0.25,
    )  # straight flight: a step would jump over the pillar


def _floor(t, y):
    """Set the first coordinate to zero, the height of the floor."""
    y[0] = 0.0


SCRIPTS = {
    "apple": apple,
    "tide": tide,
    "tide_again": tide,
    "moving_floor": moving_floor,
    "stiff_contact": stiff_contact,
    "play": play,
    "box_turning": box_turning,
    "graze": graze,
    "wedge": wedge,
    "obstacle": obstacle,
}
