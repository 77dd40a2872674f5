"""Ranges and Jacobians on one piece of a step, for every state in a tube about the path.

Used by nsbench.reference.certify.error_bound.
"""

from __future__ import annotations

import numpy as np
from flint import arb, arb_mat, arb_poly

from nsbench.reference.certify.array_namespace import Branches, noted, watching
from nsbench.reference.certify.ball_algebra import (
    MAX_ORDER_OF_ZERO,
    ZERO_AT_EVENT,
    Refused,
    ball,
    lead,
    order_of_zero,
    positive,
)
from nsbench.reference.certify.ball_series import Jet, Number
from nsbench.reference.certify.dual_numbers import Dual
from nsbench.reference.certify.taylor_step import coefficients

TUBE = 1e-18  # radius of the tube over which derivatives are bounded; the path must stay far inside
# of the Taylor polynomials of defects on a piece: its length is a small part of a radius
ORDER = 30


class PieceBounds:
    """Bound everything on one piece: Taylor polynomials about its centre with remainders, and
    slopes in a tube.

    low, high: the piece relative to the centre. r: error bound at its start. mu, defect, du (bound
    of |du/dx|), dw (error of w), and for every watched key a polynomial, a bound of its remainder,
    and the bound of its slope.
    """

    def __init__(self, flow, st, centre, low, high, r, series=ORDER):
        self.flow = flow
        self.st = st
        self.low = low
        self.high = high
        self.r = r
        self.notes = []
        c = centre
        span = ball(low, high)
        self.time, self.ball = (st.t + c).mid(), (st.t + c).mid() + span
        shift = lambda p, s: p(arb_poly([s, 1]))
        length = series + 1
        at = [shift(p, c) for p in st.x], [shift(p, c) for p in st.u]
        over = [shift(p, c + span) for p in st.x], [shift(p, c + span) for p in st.u]
        self.slope_ranges(over)
        if not self.finite:
            return
        old = watching(Branches(st.choices))
        try:
            exact = self._series(at, self.time, length)
            watching(Branches(st.choices))
            wide = self._series(over, self.ball, length)
        finally:
            watching(old)
        width = max(-low, high)
        self.watch = {
            k: (polynomial(v, series), remainder(wide["watch"][k], series, width))
            for k, v in exact["watch"].items()
        }
        self.rate = {k: v.leading.at(1) for k, v in wide["watch"].items()}
        bound = lambda name: float(
            sum(
                (size(v, wide[name][k], series, width) ** 2 for k, v in enumerate(exact[name])),
                start=arb(0),
            )
            .sqrt()
            .upper()
        )
        residual = bound("residual")
        self.dw = self.inverse * residual
        self.defect = bound("defect") + self.velocity_u * self.dw

    def _series(self, polynomials, time, length):
        """Evaluate the flow in series about the centre of the piece."""
        x, u = (
            [Jet.of([p[k] for k in range(length + 1)], length + 1) for p in part]
            for part in polynomials
        )
        slope = [v.derivative() for v in x]
        x = [Jet.of([v.at(k) for k in range(length)], length) for v in x]
        u = [Jet.of([v.at(k) for k in range(length)], length) for v in u]
        point = self.flow.at(Jet.of([time, 1], length + 1), x)
        velocity = point.velocity(u)
        return {
            "watch": self._watched(point, u),
            "residual": point.residual(u),
            "defect": [a - b for a, b in zip(slope, velocity, strict=True)],
        }

    def _watched(self, point, u):
        """Collect what the flow watches, and the deciders of the kinks on the side
        that was chosen.
        """
        kinks = zip(noted(), self.st.choices, strict=True)
        return point.watch(u) | {
            ("kink", k): (v if side else -v) for k, (v, side) in enumerate(kinks)
        }

    def slope_ranges(self, over: tuple[list, list]) -> None:
        """Bound the Jacobians over the tube: mu of the reduced flow, du/dx, slopes of what is
        watched.
        """
        n = self.flow.n
        m = self.flow.m
        tube = arb(0, TUBE)
        x = [
            Dual(Jet.of([p[0] + tube], 1), {i: Jet.lift(None, 1.0)}) for i, p in enumerate(over[0])
        ]
        u = [
            Dual(Jet.of([p[0] + tube], 1), {n + k: Jet.lift(None, 1.0)})
            for k, p in enumerate(over[1])
        ]
        old = watching(Branches(self.st.choices))
        try:
            point = self.flow.at(Jet.of([self.ball, 1], 2), x)
            velocity = point.velocity(u)
            residual = point.residual(u)
            force = point.force(u)
            watch = self._watched(point, u)
        finally:
            watching(old)
        V, R, F = (matrix(rows, n + m) for rows in (velocity, residual, force))
        self.du = self.dforce = self.velocity_u = self.inverse = self.force_u = 0.0
        J = V[:, :n]
        D = None
        try:
            if m:
                one = arb_mat(m, m, [int(i == j) for i in range(m) for j in range(m)])
                # preconditioned: plain elimination with wide balls makes them far wider
                S = np.array(
                    arb_mat(R[:, n:].tolist()).solve(one, algorithm="precond").tolist(), object
                )
                D = -(S @ R[:, :n])  # du/dx
                J = V[:, :n] + V[:, n:] @ D
                self.du, self.inverse, self.velocity_u = norm(D), norm(S), norm(V[:, n:])
            if len(force):
                self.dforce = norm(F[:, :n] + F[:, n:] @ D) if m else norm(F[:, :n])
                self.force_u = norm(F[:, n:]) if m else 0.0
            self.mu = logarithmic_norm(J)
        except ZeroDivisionError:
            self.mu = float("nan")
        self.speed, self.size_u = norm(matrix_of(velocity)), norm(matrix_of(u))
        self.size_force = norm(matrix_of(force))
        self.slopes = {}
        self.by_u = {}
        for key, v in watch.items():
            row = matrix([v], n + m)
            self.by_u[key] = norm(row[:, n:])
            self.slopes[key] = (
                norm(row[:, :n] + row[:, n:] @ D) if m and D is not None else norm(row[:, :n])
            )
        self.finite = bool(
            np.isfinite([self.mu, self.du, self.dforce, self.speed, *self.slopes.values()]).all()
        )

    def wrong_sign(self, r: float, first: bool, last: bool) -> str | None:
        """Prove that everything watched is positive on the piece for all states within r.

        Returns None if that is shown, else a sentence.
        """
        for key, (p, rest) in self.watch.items():
            allow = float(
                (
                    arb(self.slopes[key]) * arb(r) + arb(self.by_u[key]) * arb(self.dw) + arb(rest)
                ).upper()
            )
            if positive(p, self.low, self.high, allow, depth=2) is None:
                continue
            if self._vanishes(key, p, rest):
                continue
            if (first or last) and order_of_zero([p[0]]):
                why = self._leaves_zero(key, p, first)
                if why is None:
                    continue
                return why
            s = positive(p, self.low, self.high, allow)
            if s is not None and not self._touches(key, p, allow):
                value = float(p(arb(s)).mid())
                why = (
                    f"{key[0]} of {key[1]} does not stay positive, or cannot be shown to: it is "
                    f"{value:.3e} at t = "
                    f"{float(self.time) + s:.12g}"
                )
                if value < -ZERO_AT_EVENT and p(arb(s)) < -allow:
                    raise Refused(why)  # it is negative: smaller pieces will not help
                return why
        return None

    def _vanishes(self, key, p, rest) -> bool:
        """Is the number zero all over the piece, within its remainder?"""
        if (
            not sum(abs(c) * arb(max(-self.low, self.high)) ** k for k, c in enumerate(p.coeffs()))
            + rest
            < ZERO_AT_EVENT
        ):
            return False
        self.notes.append(f"{key[0]} of {key[1]} is zero throughout")
        return True

    def _touches(self, key, p, allow) -> bool:
        """Does the number come down to zero and go up again, within its remainder? Then nothing
        acts: a graze.
        """
        s = arb(0)
        bend = p.derivative().derivative()
        for _ in range(20):
            s = (s - p.derivative()(s) / bend(s)).mid() if bend(s) != 0 else arb("nan")
        inside = s.is_finite() and self.low <= float(s) <= self.high
        if not (
            inside and abs(p(s)) + allow < ZERO_AT_EVENT and bend(ball(self.low, self.high)) > 0
        ):
            return False
        self.notes.append(
            f"{key[0]} of {key[1]} touches zero at t = {float(self.time + s):.9g} without "
            f"contact, to "
            f"{ZERO_AT_EVENT:.0e},"
        )
        return True

    def _leaves_zero(self, key, p, first):
        """Does the first non-vanishing derivative of a zero at the end of an arc keep its sign on
        the piece?
        """
        m = order_of_zero([p[k] for k in range(MAX_ORDER_OF_ZERO + 1)])
        if m > MAX_ORDER_OF_ZERO:
            return f"{key[0]} of {key[1]} vanishes to high order near t = {float(self.time):.12g}"
        x = [q(self.ball - self.st.t) + arb(0, TUBE) for q in self.st.x]
        x, u, _ = coefficients(self.flow, self.ball, x, m + 1, self.st.choices)
        old = watching(Branches(self.st.choices))
        try:
            point = self.flow.at(
                Jet.of([self.ball, 1], m + 2), [Jet.of(c[: m + 1], m + 1) for c in x]
            )
            value = self._watched(point, [Jet.of(c, m + 1) for c in u])[key]
        finally:
            watching(old)
        if value.leading.at(m) * (1 if first or m % 2 == 0 else -1) > 0:
            return None
        return (
            f"{key[0]} of {key[1]} leaves zero in the wrong direction near t = "
            f"{float(self.time):.12g}"
        )


def polynomial(number: Number, count: int) -> arb_poly:
    return arb_poly([number.leading.at(k) for k in range(count)])


def remainder(number: Number, k: int, width: float) -> float:
    return float((number.leading.at(k).abs_upper() * arb(width) ** k).upper())


def size(number: Number, wide: Number, k: int, width: float) -> arb:
    """Bound a Taylor polynomial with k terms and its remainder on the piece."""
    terms = sum(
        (number.leading.at(j).abs_upper() * arb(width) ** j for j in range(k)), start=arb(0)
    )
    return terms + wide.leading.at(k).abs_upper() * arb(width) ** k


def matrix(rows: list[Number], columns: int) -> np.ndarray:
    """Collect the derivatives of Duals in an object array of arb (len(rows), columns)."""
    out = np.full((len(rows), columns), arb(0), object)
    for i, v in enumerate(rows):
        v = v.v if isinstance(v, Dual) and v.level > 1 else v
        if isinstance(v, Dual):
            for j, a in v.d.items():
                out[i, j] = a.leading.at(0)
    return out


def matrix_of(values: list[Number]) -> np.ndarray:
    return np.array([[lead(v)] for v in values], object).reshape(len(values), 1)


def norm(M: np.ndarray) -> float:
    """Bound the 2-norm by the Frobenius norm, rounded upwards."""
    return float(
        sum((v.abs_upper() ** 2 for v in np.asarray(M, object).reshape(-1)), start=arb(0))
        .sqrt()
        .upper()
    )


def logarithmic_norm(J: np.ndarray) -> float:
    """Bound the largest eigenvalue of (J + J^T) / 2 for every J in the balls."""
    S = [[(J[i, j] + J[j, i]) / 2 for j in range(len(J))] for i in range(len(J))]
    mid = np.array([[float(v.mid()) for v in row] for row in S]).reshape(len(J), len(J))
    rad = np.array([[float(v.rad()) for v in row] for row in S]).reshape(len(J), len(J))
    if not (np.isfinite(mid).all() and np.isfinite(rad).all()):
        return float("nan")
    # rounding of the eigenvalues and of the matrix as floats: 1e-13 of its norm is a hundred times
    # what LAPACK needs
    slack = 1e-13 * np.abs(mid).sum() + rad.sum(axis=1).max(initial=0.0)
    return float(np.linalg.eigvalsh(mid)[-1] + slack)
