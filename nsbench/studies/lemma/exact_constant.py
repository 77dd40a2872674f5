"""Exact C of the linearised sweep by mixed-integer linear programming (HiGHS), and by enumeration.

For a target contact k the largest v'_k over g >= -1 is wanted. Each other contact l may choose any
g_l >= -1, so its correction may be anything between 0 and max(0, 1 - q_l), where
q_l = sum_{j before l} a_lj c_j; for k itself g_k = max(-1, -q_k) is best. Hence

    maximise   -sum_{l after k} a_kl c_l - p,        p >= q_k - 1,  p >= 0,
    subject to 0 <= c_l <= max(0, 1 - q_l).

Binaries: y_l = 1 where 1 - q_l may be negative (then c_l = 0), and, where the order is free,
o_ij = 1 if i comes before j, for the pairs with a_ij != 0 alone, with ranks t that rule out cycles.
The products u_ij = o_ij c_i are linear with the proven upper bounds of c. Every order satisfies
c . (A + I) c <= 2 sum c (docs/studies.md): tangent planes of it cut the relaxation off.

`enumerate_violation` is a second method for a few contacts: one linear programme for each order and
each set of contacts with c > 0, on which the sweep is linear.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import Bounds, LinearConstraint, linprog, milp
from scipy.sparse import csr_array

from nsbench.studies.lemma.proven_bound import bound_corrections
from nsbench.studies.packings.linear_sweep import sweep

CUT_ROUNDS = 20  # tangent planes of the energy: more do not lower the relaxation of hex7
CUT_TOLERANCE = 1e-6  # excess of the energy that is not cut off any more
CORRECTION_TOLERANCE = 1e-5  # of HiGHS: a correction or a rest below it is 0
RELATIVE_GAP = 1e-7  # between the best value and the bound of HiGHS: the value is called exact


@dataclass(frozen=True)
class Optimum:
    """Largest v' over all targets.

    value: what a sweep of the solution leaves. upper: bound of the solver. proven: are both equal,
    within RELATIVE_GAP?
    """

    value: float
    upper: float
    proven: bool


@dataclass
class _Model:
    """A linear model under construction: rows as dicts from column to coefficient."""

    columns: int = 0
    rows: list[dict[int, float]] = field(default_factory=list)
    low: list[float] = field(default_factory=list)
    high: list[float] = field(default_factory=list)

    def variables(self, count: int) -> np.ndarray:
        """Add columns and return their indices."""
        first = self.columns
        self.columns += count
        return np.arange(first, self.columns)

    def add(self, low: float, row: dict[int, float], high: float) -> None:
        """Add the constraint low <= row . x <= high."""
        self.rows.append(row)
        self.low.append(low)
        self.high.append(high)

    def constraint(self) -> LinearConstraint:
        """Return all rows as a sparse constraint."""
        entries = [(r, c, v) for r, row in enumerate(self.rows) for c, v in row.items()]
        rows, cols, values = zip(*entries, strict=True)
        shape = (len(self.rows), self.columns)
        return LinearConstraint(csr_array((values, (rows, cols)), shape=shape), self.low, self.high)


class SweepModel:
    """The mixed-integer model of one packing for all orders, or for one.

    gram (m, m), distance (m, m) in the dual graph; order (m,): fixed, or None for all orders.
    """

    def __init__(self, gram: np.ndarray, distance: np.ndarray, order: np.ndarray | None = None):
        m = len(gram)
        self.gram = gram
        self.order = order
        self.cap = bound_corrections(gram, distance)
        self.pairs = [(i, j) for i, j in itertools.combinations(range(m), 2) if gram[i, j] != 0.0]
        self.model = _Model()
        self.c = self.model.variables(m)
        self.loss = self.model.variables(1)[0]
        self.closed = self.model.variables(m)
        self.first = self.model.variables(len(self.pairs))
        self.product = self.model.variables(2 * len(self.pairs)).reshape(-1, 2)
        self.rank = self.model.variables(m)
        self.inflow: list[dict[int, float]] = [{} for _ in range(m)]
        self.low = np.zeros(self.model.columns)
        self.high = np.full(self.model.columns, np.inf)
        self._set_limits(order)
        self._add_products()
        if order is None:
            self._add_order()
        self._add_caps()

    def _set_limits(self, order) -> None:
        """Bound the columns; a given order fixes the binaries of pairs."""
        self.high[self.c] = self.cap
        # q_l cannot exceed 1 where the positive entries are too small: no binary is needed
        off = self.gram - np.diag(np.diag(self.gram))
        self.excess = np.maximum(np.maximum(off, 0.0) @ self.cap - 1.0, 0.0)
        self.high[self.closed] = self.excess > 0.0
        self.high[self.first] = 1.0
        self.high[self.rank] = len(self.gram) - 1.0
        if order is not None:
            place = np.argsort(order)
            before = np.array([place[i] < place[j] for i, j in self.pairs], dtype=float)
            self.low[self.first] = before
            self.high[self.first] = before

    def _add_products(self) -> None:
        """Define the product of a correction and of whether its contact comes before the other."""
        inf = np.inf
        for e, (i, j) in enumerate(self.pairs):
            o = self.first[e]
            for side, (source, goal) in enumerate(((i, j), (j, i))):
                u = self.product[e, side]
                c = self.c[source]
                cap = self.cap[source]
                self.inflow[goal][u] = self.gram[i, j]
                # u = c if the source comes first, else 0; o counts from i to j
                sign = 1.0 - 2.0 * side
                offset = cap * side
                self.model.add(-inf, {u: 1.0, c: -1.0}, 0.0)
                self.model.add(-inf, {u: 1.0, o: -sign * cap}, offset)
                self.model.add(offset - cap, {u: 1.0, c: -1.0, o: -sign * cap}, inf)

    def _add_order(self) -> None:
        """Rule out cycles of the pairwise order: ranks, and the triangles of the dual graph."""
        m = len(self.gram)
        index = {pair: e for e, pair in enumerate(self.pairs)}
        for (i, j), e in index.items():
            o = self.first[e]
            self.model.add(1.0 - m, {self.rank[j]: 1.0, self.rank[i]: -1.0, o: -m}, np.inf)
            self.model.add(1.0, {self.rank[i]: 1.0, self.rank[j]: -1.0, o: m}, np.inf)
            for k in range(j + 1, m):
                if (i, k) in index and (j, k) in index:
                    jk = self.first[index[j, k]]
                    ik = self.first[index[i, k]]
                    self.model.add(0.0, {o: 1.0, jk: 1.0, ik: -1.0}, 1.0)

    def _add_caps(self) -> None:
        """Add c_l <= max(0, 1 - q_l) for every contact."""
        for k, inflow in enumerate(self.inflow):
            y = self.closed[k]
            self.model.add(-np.inf, {self.c[k]: 1.0, y: -self.excess[k], **inflow}, 1.0)
            self.model.add(-np.inf, {self.c[k]: 1.0, y: self.cap[k]}, self.cap[k])

    def maximise(self, target: int, seconds: float) -> Optimum:
        """Solve the model for one target contact; seconds: time limit of HiGHS."""
        cost = np.zeros(self.model.columns)
        for (i, j), (from_i, from_j) in zip(self.pairs, self.product, strict=True):
            if target in (i, j):
                other = j if i == target else i
                u = from_j if i == target else from_i
                cost[self.c[other]] += self.gram[i, j]
                cost[u] -= self.gram[i, j]
        cost[self.loss] = 1.0
        base = len(self.model.rows)
        row = {self.loss: 1.0, **{u: -a for u, a in self.inflow[target].items()}}
        self.model.add(-1.0, row, np.inf)
        self._cut_energy(cost)
        integer = np.zeros(self.model.columns)
        integer[self.closed] = 1
        integer[self.first] = 1
        found = milp(
            cost,
            constraints=self.model.constraint(),
            bounds=Bounds(self.low, self.high),
            integrality=integer,
            options={"time_limit": seconds, "mip_rel_gap": RELATIVE_GAP},
        )
        for rows in (self.model.rows, self.model.low, self.model.high):
            del rows[base:]
        value = 0.0 if found.x is None else self._swept_value(found.x, target)
        upper = -found.mip_dual_bound if found.mip_dual_bound is not None else np.inf
        return Optimum(float(value), float(upper), bool(found.status == 0))

    def _swept_value(self, x: np.ndarray, target: int) -> float:
        """Sweep the order and the gaps of a solution; the largest v' is free of its tolerances."""
        order = np.argsort(x[self.rank], kind="stable") if self.order is None else self.order
        wanted = np.where(x[self.c] > CORRECTION_TOLERANCE, x[self.c], 0.0)
        gaps = np.zeros(len(self.gram))
        c = np.zeros(len(self.gram))
        for k in order:
            q = float(self.gram[k] @ c)
            gaps[k] = max(-1.0, -q - wanted[k])
            # within the tolerance of the solver the largest violation allowed is meant
            if gaps[k] < -1.0 + CORRECTION_TOLERANCE:
                gaps[k] = -1.0
            c[k] = max(0.0, -(gaps[k] + q))
        return float(sweep(self.gram, order, gaps).violations[target])

    def _cut_energy(self, cost) -> None:
        """Cut the relaxation by tangent planes of c . (A + I) c <= 2 sum c."""
        half = (self.gram + np.eye(len(self.gram))) / 2.0
        for _ in range(CUT_ROUNDS):
            bounds = Bounds(self.low, self.high)
            c = milp(cost, constraints=self.model.constraint(), bounds=bounds).x[self.c]
            energy = c @ half @ c
            if energy <= c.sum() + CUT_TOLERANCE:
                return
            # the tangent plane touches where the ray from 0 through c leaves the ellipsoid
            touch = c * (c.sum() / energy)
            gradient = 2.0 * half @ touch - 1.0
            row = dict(zip(self.c, gradient, strict=True))
            self.model.add(-np.inf, row, float(gradient @ touch))


def exact_violation(
    gram: np.ndarray,
    distance: np.ndarray,
    contacts: list[int],
    seconds: float,
    order: np.ndarray | None = None,
) -> Optimum:
    """Maximise v' over the targets `contacts`, over all gaps >= -1 and all orders, or one order.

    seconds: time limit for each target. Where one target is not solved in time, `proven` is False
    and `upper` is still a bound.
    """
    model = SweepModel(gram, distance, order)
    found = [model.maximise(k, seconds) for k in contacts]
    return Optimum(
        max(f.value for f in found), max(f.upper for f in found), all(f.proven for f in found)
    )


def enumerate_violation(gram: np.ndarray, order: np.ndarray | None = None) -> float:
    """Maximise v' by one linear programme per order, target and set of contacts with c > 0.

    For m contacts there are m! m 2^m of them: m is at most 4 where the order is None (all).
    """
    m = len(gram)
    orders = itertools.permutations(range(m)) if order is None else [tuple(order)]
    subsets = list(itertools.product((False, True), repeat=m))
    return max(_best_of_piece(gram, o, active) for o in orders for active in subsets)


def _best_of_piece(gram, order, active) -> float:
    """Largest v' of any contact on one linear piece of the sweep; -inf where the piece is empty."""
    m = len(gram)
    # s = gap before the own projection and c = correction, as linear functions of g: rows (m, m)
    s = np.zeros((m, m))
    c = np.zeros((m, m))
    for k in order:
        s[k] = np.eye(m)[k] + gram[k] @ c
        if active[k]:
            c[k] = -s[k]
    sign = np.where(active, 1.0, -1.0)
    after = np.eye(m) + gram @ c
    best = -np.inf
    for k in range(m):
        # s <= 0 where a contact is projected, s >= 0 elsewhere; minimise g'_k
        found = linprog(
            after[k], A_ub=sign[:, None] * s, b_ub=np.zeros(m), bounds=[(-1.0, None)] * m
        )
        if found.status == 0:
            best = max(best, -found.fun)
    return best
