"""Is a polynomial positive on an interval? A proof by balls, not by samples."""

from __future__ import annotations

from flint import arb, arb_poly

DEPTH = 24  # bisections before an interval is given up
ZERO = (
    1e-20  # a value at the end of an arc this small is the zero that the event there is defined by
)
MULTIPLE = 4  # highest order of such a zero


def ball(low: float, high: float) -> arb:
    """The interval [low, high] as a ball, rounded outwards."""
    return arb((arb(low) + arb(high)).mid() / 2, ((arb(high) - arb(low)) / 2).abs_upper())


def positive(p: arb_poly, low: float, high: float, allow: float, depth: int = DEPTH):
    """None if p > allow on [low, high], else a point of the interval on which that could not be
    shown."""
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


def order_of_zero(coefficients) -> int:
    """How many leading coefficients count as zero; MULTIPLE + 1 if all that are tested do."""
    for m, c in enumerate(coefficients[: MULTIPLE + 1]):
        if not abs(c) < ZERO:
            return m
    return MULTIPLE + 1
