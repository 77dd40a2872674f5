"""Algebra in balls: linear and nonlinear systems, positivity of a polynomial on an interval."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from flint import arb, arb_mat, arb_poly

from nsbench.reference.certify.ball_series import Number

MAX_BISECTIONS = 24  # before an interval is given up
# A value at the end of an arc this small is the zero that the event there is defined by
ZERO_AT_EVENT = 1e-20
MAX_ORDER_OF_ZERO = 4  # highest order of such a zero


class Refused(ValueError):
    """Report that the claimed arcs are not the solution, or cannot be shown to be; says where and
    why.
    """


def zero_of(function: Callable[[list], list], slopes: Callable[[list], arb_mat], m: int) -> list:
    """Find the zero of m equations from the origin by Newton's method.

    Raises ArithmeticError if the iteration does not settle.
    """
    s = [arb(0)] * m
    for _ in range(60):
        value = function(s)
        move = solve(slopes(s), [-v for v in value])
        s = [(a + b).mid() for a, b in zip(s, move, strict=True)]
        if max(abs(float(v)) for v in move) < 1e-45:
            return s
    raise ArithmeticError("the weights that keep the state on its surfaces are not found")


def lead(v: Number | arb | float) -> arb:
    """Return the leading coefficient of a number of any kind."""
    return v.leading.at(0) if isinstance(v, Number) else arb(v)


def solve(M: arb_mat, b: list) -> list:
    """Solve M u = b for balls: Gauss elimination after multiplication with an
    approximate inverse.
    """
    if not b:
        return []
    return [
        v for row in M.solve(arb_mat([[v] for v in b]), algorithm="precond").tolist() for v in row
    ]


def ball(low: float, high: float) -> arb:
    """Enclose the interval [low, high] in a ball, rounded outwards."""
    return arb((arb(low) + arb(high)).mid() / 2, ((arb(high) - arb(low)) / 2).abs_upper())


def positive(
    p: arb_poly, low: float, high: float, allow: float, depth: int = MAX_BISECTIONS
) -> float | None:
    """Prove p > allow on [low, high] by bisection in balls.

    Returns None if it is shown, else a point of the interval on which it could not be.
    """
    slope = p.derivative()
    todo = [(low, high, depth)]
    while todo:
        a, b, left = todo.pop()
        s = ball(a, b)
        mid = arb(0.5 * (a + b))
        if p(s) > allow or p(mid) + slope(s) * (s - mid) > allow:
            continue
        if left == 0 or p(mid) < -allow:
            return 0.5 * (a + b)
        todo += [(0.5 * (a + b), b, left - 1), (a, 0.5 * (a + b), left - 1)]
    return None


def order_of_zero(coefficients: Sequence[arb]) -> int:
    """Count the leading coefficients that count as zero; MULTIPLE + 1 if all that are tested do."""
    for m, c in enumerate(coefficients[: MAX_ORDER_OF_ZERO + 1]):
        if not abs(c) < ZERO_AT_EVENT:
            return m
    return MAX_ORDER_OF_ZERO + 1
