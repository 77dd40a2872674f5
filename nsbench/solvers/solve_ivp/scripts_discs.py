"""Scripts of modes of few discs, written by hand (see hybrid_automaton.py).

Each function builds the script of the case of its name, with the parameters of the case.
"""

from __future__ import annotations

from math import hypot

import numpy as np

from nsbench.case import Case
from nsbench.solvers.solve_ivp.hybrid_automaton import Arc, Exit, Script

NONE = [0.0] * 9
THIRDS = 2.0 / 3.0


def two_discs(case: Case, w: float = 0.0) -> Script:
    """Script two discs that spiral to the origin (rate of turning w) until they touch."""

    def free(t: float, y: np.ndarray) -> list[float]:
        a, b, c, d, *_ = y
        return [-a - w * b, -b + w * a, -c - w * d, -d + w * c, 0.0, 0.0, 0.0, 0.0, 0.0]

    def together(t: float, y: np.ndarray) -> list[float]:
        a, b, c, d, *_ = y
        # lam n: half the distance along the normal
        p = 0.5 * (a - c)
        q = 0.5 * (b - d)
        return [
            p - a - w * b,
            q - b + w * a,
            -p - c - w * d,
            -q - d + w * c,
            hypot(p, q),
            p,
            q,
            -p,
            -q,
        ]

    meet = Exit(
        lambda t, y: hypot(y[0] - y[2], y[1] - y[3]) - 2.0,
        -1,
        "together",
        "contact",
        (0, 0, 1),
    )
    return Script(
        {"free": Arc(free, (meet,)), "together": Arc(together)}, "free", ((0, 0, 1),), None
    )


def _gap(i, j):
    """Return the gap of discs i and j as a function (t, y)."""
    i = 2 * i
    j = 2 * j
    return lambda t, y: hypot(y[i] - y[j], y[i + 1] - y[j + 1]) - 2.0


def _three_free(t, y):
    """Return the rates of state and integrals while every disc moves to the origin alone."""
    a, b, c, d, e, f = y[:6]
    return [-a, -b, -c, -d, -e, -f, *NONE]


def _three_pair(t, y):
    """Return the rates while discs 0 and 1 are in contact."""
    a, b, c, d, e, f = y[:6]
    p = 0.5 * (a - c)
    q = 0.5 * (b - d)
    return [p - a, q - b, -p - c, -q - d, -e, -f, hypot(p, q), 0.0, 0.0, p, q, -p, -q, 0.0, 0.0]


def _three_hinge(t, y):
    """Return the rates while disc 1 is in contact with both others.

    [[2, -m], [-m, 2]] (lam, mu) = (r, s), with m the cosine between the two normals.
    """
    a, b, c, d, e, f = y[:6]
    p = a - c
    q = b - d
    u = c - e
    v = d - f
    r = hypot(p, q)
    s = hypot(u, v)
    p = p / r
    q = q / r
    u = u / s
    v = v / s
    m = p * u + q * v
    lam = (2.0 * r + m * s) / (4.0 - m * m)
    mu = (2.0 * s + m * r) / (4.0 - m * m)
    p = lam * p
    q = lam * q
    u = mu * u
    v = mu * v
    return [
        p - a,
        q - b,
        u - p - c,
        v - q - d,
        -u - e,
        -v - f,
        lam,
        0.0,
        mu,
        p,
        q,
        u - p,
        v - q,
        -u,
        -v,
    ]


def _three_triangle(t, y):
    """Return the rates while all are in contact: the mean goes on, the rest stands still."""
    a, b, c, d, e, f = y[:6]
    p = -(a + c + e) / 3.0
    q = -(b + d + f) / 3.0
    return [p, q, p, q, p, q, THIRDS, THIRDS, THIRDS, p + a, q + b, p + c, q + d, p + e, q + f]


def three_discs(case: Case, overlap: str = "none") -> Script | None:
    """Script three discs that move to the origin; None for starts with an overlap.

    Discs 0 and 1 meet, then 1 and 2; the hinge folds until 0 and 2 meet; from there on every lam is
    2/3.
    """
    if overlap != "none":
        return None
    return Script(
        {
            "free": Arc(_three_free, (Exit(_gap(0, 1), -1, "pair", "contact", (0, 0, 1)),)),
            "pair": Arc(_three_pair, (Exit(_gap(1, 2), -1, "hinge", "contact", (0, 1, 2)),)),
            "hinge": Arc(_three_hinge, (Exit(_gap(0, 2), -1, "triangle", "contact", (0, 0, 2)),)),
            "triangle": Arc(_three_triangle),
        },
        "free",
        ((0, 0, 1), (0, 0, 2), (0, 1, 2)),
        None,
    )


SCRIPTS = {
    "two_discs": two_discs,
    "three_discs": three_discs,
}
