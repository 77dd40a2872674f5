"""Leading coefficients and small systems of equations in balls."""

from __future__ import annotations

from flint import arb, arb_mat

from nsbench.reference.certify.ball_series import Number


class Refused(ValueError):
    """The claimed arcs are not the solution, or cannot be shown to be; the message says where and
    why."""


def zero_of(function, slopes, m: int) -> list:
    """The zero of m equations from the origin by Newton's method; ArithmeticError if it does not
    settle."""
    s = [arb(0)] * m
    for _ in range(60):
        value = function(s)
        move = solve(slopes(s), [-v for v in value])
        s = [(a + b).mid() for a, b in zip(s, move, strict=True)]
        if max(abs(float(v)) for v in move) < 1e-45:
            return s
    raise ArithmeticError("the weights that keep the state on its surfaces are not found")


def lead(v) -> arb:
    return v.leading.at(0) if isinstance(v, Number) else arb(v)


def solve(M: arb_mat, b: list) -> list:
    """M u = b for balls, by Gauss after multiplication with an approximate inverse."""
    if not b:
        return []
    return [
        v for row in M.solve(arb_mat([[v] for v in b]), algorithm="precond").tolist() for v in row
    ]
