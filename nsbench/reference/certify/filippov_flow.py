"""Equations of one arc of a Filippov system, sliding included, for numbers of any kind.

Their form is that of nsbench.reference.certify.contact_flow.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np
from flint import arb, arb_mat

from nsbench.case import Case
from nsbench.reference.certify.array_namespace import NAMESPACE, vector
from nsbench.reference.certify.ball_algebra import lead, zero_of
from nsbench.reference.certify.ball_series import Jet, Number
from nsbench.reference.certify.dual_numbers import INNER, Dual, array


class SlidingFlow:
    """Describe the Filippov system in the mode p (+1, -1 off a surface, 0 on it); unknowns are the
    signs of the surfaces with 0.
    """

    def __init__(self, case: Case, mode):
        self.case = case
        self.n = case.n
        self.mode = tuple(int(v) for v in mode)
        self.on = [i for i, v in enumerate(self.mode) if v == 0]
        self.m = len(self.on)
        self.shut = ()
        self.field, self.switch = case.problem.field(NAMESPACE), case.problem.switch(NAMESPACE)

    def at(self, t: Jet, x: list[Number]) -> SlidingPoint:
        return SlidingPoint(self, t, x)

    def names(self) -> tuple[tuple[int, int], ...]:
        return tuple((0, i) for i in range(len(self.mode)))

    def invariants(self, point: SlidingPoint) -> list[Number]:
        return [point.c[i] for i in self.on]


class SlidingPoint:
    """Evaluate velocity, switches and margins of a sliding flow at one time and state."""

    def __init__(self, flow: SlidingFlow, t: Jet, x: list[Number]):
        self.flow = flow
        n = flow.n
        one = Jet.lift(None, 1.0)
        d = len(flow.mode)
        duals = array([Dual(v, {i: one}, INNER) for i, v in enumerate(x)])
        c = vector(flow.switch(Dual(t, {n: one}, INNER), duals), d)
        c = [v if isinstance(v, Dual) and v.level == INNER else Dual(v, {}, INNER) for v in c]
        self.c = [v.v for v in c]
        self.corners = {}
        for code in product((1, -1), repeat=flow.m):
            s = np.array(flow.mode, float)
            s[flow.on] = code
            # balls, which compare as floats do: B s of a relay would be rounded to doubles
            exact = array([arb(v) for v in s])
            F = vector(flow.field(t, array(x), exact), n)
            self.corners[code] = F, [_along(c[i].d, F, n) for i in flow.on]

    def _blend(self, values, u):
        """Interpolate multilinearly in the signs u: corners weighted by products of (1 + s)/2 and
        (1 - s)/2.
        """
        if not u:
            return values[()]
        weights = [{1: 0.5 * (1.0 + s), -1: 0.5 * (1.0 - s)} for s in u]
        total = None
        for code, vector_ in values.items():
            w = weights[0][code[0]]
            for k in range(1, len(code)):
                w = w * weights[k][code[k]]
            part = [w * v for v in vector_]
            total = part if total is None else [a + b for a, b in zip(total, part, strict=True)]
        return total

    def velocity(self, u: Sequence[Number]) -> list[Number]:
        return self._blend({k: v[0] for k, v in self.corners.items()}, list(u))

    def residual(self, u: Sequence[Number]) -> list[Number]:
        return self._blend({k: v[1] for k, v in self.corners.items()}, list(u))

    def matrix(self, u: Sequence[Number]) -> arb_mat:
        signs = [Dual(Jet.lift(None, lead(v)), {k: Jet.lift(None, 1.0)}) for k, v in enumerate(u)]
        rates = {k: [Jet.lift(None, lead(r)) for r in v[1]] for k, v in self.corners.items()}
        rows = self._blend(rates, signs)
        return arb_mat(
            [[r.d[k].at(0) if k in r.d else arb(0) for k in range(self.flow.m)] for r in rows]
        )

    def start(self) -> list[arb]:
        """Compute the leading coefficients of the unknown signs."""
        if self.flow.m == 0:
            return []
        if self.flow.m == 1:
            plus = lead(self.corners[(1,)][1][0])
            minus = lead(self.corners[(-1,)][1][0])
            return [(plus + minus) / (minus - plus)]
        rates = {k: [Jet.lift(None, lead(r)) for r in v[1]] for k, v in self.corners.items()}
        return zero_of(
            lambda s: [v.at(0) for v in self._blend(rates, [Jet.lift(None, v) for v in s])],
            lambda s: self.matrix([Jet.lift(None, v) for v in s]),
            self.flow.m,
        )

    def watch(self, u: Sequence[Number]) -> dict[tuple, Number]:
        out = {("side", (0, i)): p * self.c[i] for i, p in enumerate(self.flow.mode) if p}
        for i, s in zip(self.flow.on, u, strict=True):
            out |= {("upper", (0, i)): 1.0 - s, ("lower", (0, i)): 1.0 + s}
        return out

    def rates_of_impulse(self, u: Sequence[Number]) -> list[Number]:
        s = dict(zip(self.flow.on, u, strict=True))
        return [
            0.5 * (1.0 + s[i]) if i in s else Jet.lift(None, 0.5 * (1 + p))
            for i, p in enumerate(self.flow.mode)
        ]

    def force(self, u: Sequence[Number]) -> list[Number]:
        return []


def _along(d, F, n):
    return sum((a * (F[j] if j < n else 1.0) for j, a in d.items()), start=Jet.lift(None, 0.0))
