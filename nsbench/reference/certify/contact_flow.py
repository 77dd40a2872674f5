"""Equations of one arc with active contacts, for numbers of any kind: velocity, multipliers, signs.

A flow has unknowns u (multipliers of the active contacts, or signs of the sliding surfaces) given
by residual(u) = 0, and x' = velocity(u). `watch` lists what the arc claims to be non-negative: gaps
of the other contacts, the multipliers, the sides of the surfaces and the margins of the signs. The
solution of the system through a state is unique, so a curve that solves the equations and keeps
these signs is the solution.
"""

from __future__ import annotations

import numpy as np
from flint import arb, arb_mat

from nsbench.case import Case
from nsbench.problem import Affine, Complementarity, Distance, Filippov
from nsbench.reference.certify.array_namespace import NAMESPACE, vector
from nsbench.reference.certify.ball_algebra import lead, solve
from nsbench.reference.certify.ball_series import Jet, Number
from nsbench.reference.certify.constraint_list import Row, rows_of
from nsbench.reference.certify.dual_numbers import INNER, Dual, array


class ContactFlow:
    """Describe the complementarity system with the (independent) contacts `held` at zero; `shut`
    follow from them.
    """

    def __init__(self, case: Case, held=(), shut=(), rows=None):
        self.case = case
        self.n = case.n
        rows = rows_of(case) if rows is None else rows
        by_id = {r.id: r for r in rows}
        self.all_rows = rows
        self.held = [by_id[c] for c in held]
        self.shut = tuple(c for c in shut if c not in held)
        self.others = [r for r in rows if r.id not in set(held) | set(self.shut)]
        self.m = len(self.held)
        self.drift = case.problem.drift(NAMESPACE)
        self._factories = {}
        for k, c in enumerate(case.problem.constraints):
            part = c.b if isinstance(c, Affine) else c.anchors if isinstance(c, Distance) else c.g
            if callable(part):
                self._factories[k] = part(NAMESPACE)

    def at(self, t: Jet, x: list) -> ContactPoint:
        """Evaluate at time t (one coefficient longer than the state) and state x (n numbers)."""
        return ContactPoint(self, t, x)

    def names(self) -> tuple[tuple, ...]:
        """List the ids of the impulses, in the order of `rates`."""
        return tuple(r.id for r in self.held)

    def invariants(self, point: ContactPoint) -> list:
        return [point.gap(r) for r in self.held]


class ContactPoint:
    """Evaluate gaps, gradients and velocity of a contact flow at one time and state."""

    def __init__(self, flow, t, x):
        self.flow = flow
        self.t = t
        self.x = x
        self._curves = {}
        self._smooth = {}
        self.f = vector(flow.drift(t, array(x)), flow.n)
        self.grads = [self.gradient(r) for r in flow.held]
        self.rates = [self.rate(r) for r in flow.held]

    def _curve(self, k):
        """Evaluate a moving family: b(t) or anchors(t)."""
        if k not in self._curves:
            self._curves[k] = np.asarray(self.flow._factories[k](self.t), object)
        return self._curves[k]

    def _g(self, r):
        if r.family not in self._smooth:
            one = Jet.lift(None, 1.0)
            x = array([Dual(v, {i: one}, INNER) for i, v in enumerate(self.x)])
            value = np.asarray(
                self.flow._factories[r.family](Dual(self.t, {self.flow.n: one}, INNER), x), object
            )
            self._smooth[r.family] = value.reshape(-1)
        return self._smooth[r.family][r.index]

    def _difference(self, r):
        if r.kind == "pair":
            return [self.x[a] - self.x[b] for a, b in zip(r.cols, r.other, strict=True)]
        c = self.flow.case.problem.constraints[r.family]
        anchor = (self._curve(r.family) if c.moving else c.anchors)[r.index]
        return [self.x[a] - b for a, b in zip(r.cols, anchor, strict=True)]

    def gap(self, r: Row) -> Number:
        """Evaluate the gap g of a constraint."""
        if r.kind == "smooth":
            g = self._g(r)
            return g.v if isinstance(g, Dual) and g.level == INNER else g
        if r.kind == "affine":
            c = self.flow.case.problem.constraints[r.family]
            b = self._curve(r.family)[r.index] if c.moving else c.b[r.index]
            return sum(
                (v * self.x[j] for j, v in zip(r.cols, r.vals, strict=True)),
                start=Jet.lift(None, 0.0) + b,
            )
        size = sum(v * v for v in self._difference(r)).sqrt()
        d = arb(r.d[0]) + arb(r.d[1]) if isinstance(r.d, tuple) else r.d
        return r.sign * (size - d)

    def side(self, r: Row) -> Number:
        """Evaluate a smooth number with the sign of the gap: of distances the squares, which have
        no kink at coincidence.
        """
        if r.kind in ("smooth", "affine"):
            return self.gap(r)
        d = arb(r.d[0]) + arb(r.d[1]) if isinstance(r.d, tuple) else arb(r.d)
        return r.sign * (sum(v * v for v in self._difference(r)) - d * d)

    def gradient(self, r: Row) -> dict:
        """Evaluate the gradient of a gap: {column: number}."""
        if r.kind == "smooth":
            g = self._g(r)
            return {j: v for j, v in g.d.items() if j < self.flow.n} if isinstance(g, Dual) else {}
        if r.kind == "affine":
            return dict(zip(r.cols, r.vals, strict=True))
        diff = self._difference(r)
        scale = r.sign / sum(v * v for v in diff).sqrt()
        unit = [v * scale for v in diff]
        out = dict(zip(r.cols, unit, strict=True))
        return out | (
            dict(zip(r.other, [-u for u in unit], strict=True)) if r.kind == "pair" else {}
        )

    def rate(self, r: Row) -> Number | float:
        """Evaluate dg/dt at fixed x."""
        c = self.flow.case.problem.constraints[r.family]
        if r.kind == "smooth":
            g = self._g(r)
            return g.d.get(self.flow.n, 0.0) if isinstance(g, Dual) else 0.0
        if not c.moving:
            return 0.0
        value = self._curve(r.family)[r.index]
        if r.kind == "affine":
            return _slope(value)
        grad = self.gradient(r)
        return sum(
            (-1.0 * grad[j] * _slope(v) for j, v in zip(r.cols, value, strict=True)),
            start=Jet.lift(None, 0.0),
        )

    def velocity(self, u: list[Number]) -> list:
        v = list(self.f)
        for lam, grad in zip(u, self.grads, strict=True):
            for j, a in grad.items():
                v[j] = v[j] + lam * a
        return v

    def residual(self, u: list[Number]) -> list:
        """Evaluate d g_k / dt along the motion for the active contacts."""
        v = self.velocity(u)
        return [
            sum((a * v[j] for j, a in grad.items()), start=Jet.lift(None, 0.0) + rate)
            for grad, rate in zip(self.grads, self.rates, strict=True)
        ]

    def matrix(self, u: list[Number]) -> arb_mat:
        """Return d residual / d u in the leading coefficients: G G^T."""
        G = [{j: lead(a) for j, a in grad.items()} for grad in self.grads]
        return arb_mat(
            [[sum((a[j] * b[j] for j in a if j in b), start=arb(0)) for b in G] for a in G]
        )

    def start(self) -> list:
        """Compute the leading coefficients of the unknowns."""
        zero = [Jet.lift(None, 0.0)] * self.flow.m
        return solve(self.matrix(zero), [-lead(v) for v in self.residual(zero)])

    def watch(self, u: list[Number]) -> dict:
        """Collect what is claimed to be non-negative, by (what, id); gaps as `side`."""
        out = {("gap", r.id): self.side(r) for r in self.flow.others}
        return out | {("lam", r.id): v for r, v in zip(self.flow.held, u, strict=True)}

    def rates_of_impulse(self, u: list[Number]) -> list:
        return list(u)

    def force(self, u: list[Number]) -> list:
        return [v - f for v, f in zip(self.velocity(u), self.f, strict=True)]


def _slope(value):
    return value.derivative() if isinstance(value, Jet) else 0.0


def make_flow(case: Case, arc, rows=None):
    """Build the flow of a claimed arc: contacts or sliding mode."""
    if isinstance(case.problem, Complementarity):
        return ContactFlow(case, arc.held, arc.shut, rows)
    if isinstance(case.problem, Filippov):
        from nsbench.reference.certify.filippov_flow import SlidingFlow

        return SlidingFlow(case, arc.mode)
    raise ValueError(f"certificates know no {type(case.problem).__name__} systems")
