"""The equations of one arc, for numbers of any kind: velocity, algebraic unknowns, and what must stay positive.

A flow has unknowns u (multipliers of the contacts held, or signs of the surfaces slid on) given by residual(u) = 0;
x' = velocity(u). `watch` lists what the arc claims to be non-negative: gaps of the other contacts, the multipliers, the
sides of the surfaces and the room that is left to the signs. The solution of the system through a state is unique, so
a curve that solves the equations and keeps these signs is the solution.
"""
from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from flint import arb, arb_mat

from nsbench.case import Case
from nsbench.contacts import Scene
from nsbench.problem import Affine, Complementarity, Distance, Filippov
from nsbench.reference.jets import Dual, Jet, Number, array
from nsbench.reference.namespace import NAMESPACE, vector

INNER = 2               # level of the derivatives that make gradients; level 1 is left for those of the whole flow


@dataclass(frozen=True)
class Row:
    """One constraint: its id, its family's number, kind, and what the kind needs (columns, values, sign, distance)."""
    id: tuple
    family: int
    kind: str
    index: int
    cols: tuple = ()
    vals: tuple = ()
    other: tuple = ()
    d: float = 0.0
    sign: int = 1


def rows_of(case: Case) -> list[Row]:
    """Every constraint of a small scene, all pairs listed, in the stated order."""
    scene, out = Scene(case.problem, case.n), []
    for k, c in enumerate(case.problem.constraints):
        if isinstance(c, Affine):
            for i in range(c.shape[0]):
                e = slice(c.indptr[i], c.indptr[i + 1])
                out.append(Row((k, i), k, "affine", i, tuple(c.indices[e].tolist()), tuple(c.data[e].tolist())))
        elif isinstance(c, Distance):
            out += _distances(k, c, case.n, scene)
        else:
            count = len(np.atleast_1d(c.g(np)(float(case.t[0]), case.x0)))
            out += [Row((k, i), k, "smooth", i) for i in range(count)]
    return out


def _distances(k, c, n, scene):
    count = c.particles(n)
    place = lambda i: tuple(range(c.start + i * c.dim, c.start + (i + 1) * c.dim))
    if c.all_pairs:
        r = scene.radii[k]
        size = (lambda i, j: 2 * float(r[i])) if c.radii is None else (lambda i, j: (float(r[i]), float(r[j])))
        return [Row((k, i, j), k, "pair", -1, place(i), (), place(j), size(i, j), 1)
                for i in range(count) for j in range(i + 1, count)]
    pairs = c.pairs
    if pairs is None:
        pairs = np.stack(np.indices((count, len(np.asarray(c.anchors(np)(0.0) if c.moving else c.anchors)))), -1)
        pairs = pairs.reshape(-1, 2)
    d, kind = np.broadcast_to(c.d, len(pairs)), "pair" if c.anchors is None else "anchor"
    return [Row((k, int(i), int(j)), k, kind, int(j), place(int(i)), (), place(int(j)) if kind == "pair" else (),
                float(d[m]), c.sign) for m, (i, j) in enumerate(pairs)]


class ContactFlow:
    """Complementarity system with the contacts `held` (independent) at zero; `shut` follow from them."""

    def __init__(self, case: Case, held=(), shut=(), rows=None):
        self.case, self.n = case, case.n
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
        """Evaluations at time t (one coefficient longer than the state) and state x (n numbers)."""
        return ContactPoint(self, t, x)

    def names(self):
        """Ids of the impulses, in the order of `rates`."""
        return tuple(r.id for r in self.held)

    def invariants(self, point) -> list:
        return [point.gap(r) for r in self.held]


class ContactPoint:
    def __init__(self, flow, t, x):
        self.flow, self.t, self.x = flow, t, x
        self._curves, self._smooth = {}, {}
        self.f = vector(flow.drift(t, array(x)), flow.n)
        self.grads = [self.gradient(r) for r in flow.held]
        self.rates = [self.rate(r) for r in flow.held]

    def _curve(self, k):
        """Values of a moving family: b(t) or anchors(t)."""
        if k not in self._curves:
            self._curves[k] = np.asarray(self.flow._factories[k](self.t), object)
        return self._curves[k]

    def _g(self, r):
        if r.family not in self._smooth:
            one = Jet.lift(None, 1.0)
            x = array([Dual(v, {i: one}, INNER) for i, v in enumerate(self.x)])
            value = np.asarray(self.flow._factories[r.family](Dual(self.t, {self.flow.n: one}, INNER), x), object)
            self._smooth[r.family] = value.reshape(-1)
        return self._smooth[r.family][r.index]

    def _difference(self, r):
        if r.kind == "pair":
            return [self.x[a] - self.x[b] for a, b in zip(r.cols, r.other, strict=True)]
        c = self.flow.case.problem.constraints[r.family]
        anchor = (self._curve(r.family) if c.moving else c.anchors)[r.index]
        return [self.x[a] - b for a, b in zip(r.cols, anchor, strict=True)]

    def gap(self, r: Row):
        if r.kind == "smooth":
            g = self._g(r)
            return g.v if isinstance(g, Dual) and g.level == INNER else g
        if r.kind == "affine":
            c = self.flow.case.problem.constraints[r.family]
            b = self._curve(r.family)[r.index] if c.moving else c.b[r.index]
            return sum((v * self.x[j] for j, v in zip(r.cols, r.vals, strict=True)), start=Jet.lift(None, 0.0) + b)
        size = sum(v * v for v in self._difference(r)).sqrt()
        d = arb(r.d[0]) + arb(r.d[1]) if isinstance(r.d, tuple) else r.d
        return r.sign * (size - d)

    def side(self, r: Row):
        """A smooth number with the sign of the gap: of distances the squares, which have no kink at coincidence."""
        if r.kind in ("smooth", "affine"):
            return self.gap(r)
        d = arb(r.d[0]) + arb(r.d[1]) if isinstance(r.d, tuple) else arb(r.d)
        return r.sign * (sum(v * v for v in self._difference(r)) - d * d)

    def gradient(self, r: Row) -> dict:
        if r.kind == "smooth":
            g = self._g(r)
            return {j: v for j, v in g.d.items() if j < self.flow.n} if isinstance(g, Dual) else {}
        if r.kind == "affine":
            return dict(zip(r.cols, r.vals, strict=True))
        diff = self._difference(r)
        scale = r.sign / sum(v * v for v in diff).sqrt()
        unit = [v * scale for v in diff]
        out = dict(zip(r.cols, unit, strict=True))
        return out | (dict(zip(r.other, [-u for u in unit], strict=True)) if r.kind == "pair" else {})

    def rate(self, r: Row):
        """dg/dt at fixed x."""
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
        return sum((-1.0 * grad[j] * _slope(v) for j, v in zip(r.cols, value, strict=True)), start=Jet.lift(None, 0.0))

    def velocity(self, u) -> list:
        v = list(self.f)
        for lam, grad in zip(u, self.grads, strict=True):
            for j, a in grad.items():
                v[j] = v[j] + lam * a
        return v

    def residual(self, u) -> list:
        """d g_k / dt along the motion, of the contacts held."""
        v = self.velocity(u)
        return [sum((a * v[j] for j, a in grad.items()), start=Jet.lift(None, 0.0) + rate)
                for grad, rate in zip(self.grads, self.rates, strict=True)]

    def matrix(self, u) -> arb_mat:
        """d residual / d u in the leading coefficients: G G^T."""
        G = [{j: _lead(a) for j, a in grad.items()} for grad in self.grads]
        return arb_mat([[sum((a[j] * b[j] for j in a if j in b), start=arb(0)) for b in G] for a in G])

    def start(self) -> list:
        """Leading coefficients of the unknowns."""
        zero = [Jet.lift(None, 0.0)] * self.flow.m
        return solve(self.matrix(zero), [-_lead(v) for v in self.residual(zero)])

    def watch(self, u) -> dict:
        """What is claimed to be non-negative, by (what, id); gaps as `side`."""
        out = {("gap", r.id): self.side(r) for r in self.flow.others}
        return out | {("lam", r.id): v for r, v in zip(self.flow.held, u, strict=True)}

    def rates_of_impulse(self, u) -> list:
        return list(u)

    def force(self, u) -> list:
        return [v - f for v, f in zip(self.velocity(u), self.f, strict=True)]


class SlidingFlow:
    """Filippov system in the mode p (+1, -1 beside a surface, 0 on it); unknowns are the signs of the surfaces with 0."""

    def __init__(self, case: Case, mode):
        self.case, self.n, self.mode = case, case.n, tuple(int(v) for v in mode)
        self.on = [i for i, v in enumerate(self.mode) if v == 0]
        self.m, self.shut = len(self.on), ()
        self.field, self.switch = case.problem.field(NAMESPACE), case.problem.switch(NAMESPACE)

    def at(self, t, x):
        return SlidingPoint(self, t, x)

    def names(self):
        return tuple((0, i) for i in range(len(self.mode)))

    def invariants(self, point):
        return [point.c[i] for i in self.on]


class SlidingPoint:
    def __init__(self, flow, t, x):
        self.flow, n = flow, flow.n
        one, d = Jet.lift(None, 1.0), len(flow.mode)
        duals = array([Dual(v, {i: one}, INNER) for i, v in enumerate(x)])
        c = vector(flow.switch(Dual(t, {n: one}, INNER), duals), d)
        c = [v if isinstance(v, Dual) and v.level == INNER else Dual(v, {}, INNER) for v in c]
        self.c = [v.v for v in c]
        self.corners = {}
        for code in product((1, -1), repeat=flow.m):
            s = np.array(flow.mode, float)
            s[flow.on] = code
            F = vector(flow.field(t, array(x), s), n)
            self.corners[code] = F, [_along(c[i].d, F, n) for i in flow.on]

    def _blend(self, values, u):
        """Multilinear in the signs u: the corners weighted by products of (1 + s)/2 and (1 - s)/2."""
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

    def velocity(self, u):
        return self._blend({k: v[0] for k, v in self.corners.items()}, list(u))

    def residual(self, u):
        return self._blend({k: v[1] for k, v in self.corners.items()}, list(u))

    def matrix(self, u):
        signs = [Dual(Jet.lift(None, _lead(v)), {k: Jet.lift(None, 1.0)}) for k, v in enumerate(u)]
        rates = {k: [Jet.lift(None, _lead(r)) for r in v[1]] for k, v in self.corners.items()}
        rows = self._blend(rates, signs)
        return arb_mat([[r.d[k].at(0) if k in r.d else arb(0) for k in range(self.flow.m)] for r in rows])

    def start(self):
        if self.flow.m == 0:
            return []
        if self.flow.m == 1:
            plus, minus = _lead(self.corners[(1,)][1][0]), _lead(self.corners[(-1,)][1][0])
            return [(plus + minus) / (minus - plus)]
        rates = {k: [Jet.lift(None, _lead(r)) for r in v[1]] for k, v in self.corners.items()}
        return zero_of(lambda s: [v.at(0) for v in self._blend(rates, [Jet.lift(None, v) for v in s])],
                       lambda s: self.matrix([Jet.lift(None, v) for v in s]), self.flow.m)

    def watch(self, u):
        out = {("side", (0, i)): p * self.c[i] for i, p in enumerate(self.flow.mode) if p}
        for i, s in zip(self.flow.on, u, strict=True):
            out |= {("upper", (0, i)): 1.0 - s, ("lower", (0, i)): 1.0 + s}
        return out

    def rates_of_impulse(self, u):
        s = dict(zip(self.flow.on, u, strict=True))
        return [0.5 * (1.0 + s[i]) if i in s else Jet.lift(None, 0.5 * (1 + p)) for i, p in enumerate(self.flow.mode)]

    def force(self, u):
        return []


def zero_of(function, slopes, m: int) -> list:
    """The zero of m equations from the origin by Newton's method; ArithmeticError if it does not settle."""
    s = [arb(0)] * m
    for _ in range(60):
        value = function(s)
        move = solve(slopes(s), [-v for v in value])
        s = [(a + b).mid() for a, b in zip(s, move, strict=True)]
        if max(abs(float(v)) for v in move) < 1e-45:
            return s
    raise ArithmeticError("the weights that keep the state on its surfaces are not found")


def _along(d, F, n):
    return sum((a * (F[j] if j < n else 1.0) for j, a in d.items()), start=Jet.lift(None, 0.0))


def _slope(value):
    return value.derivative() if isinstance(value, Jet) else 0.0


def _lead(v) -> arb:
    return v.leading.at(0) if isinstance(v, Number) else arb(v)


def solve(M: arb_mat, b: list) -> list:
    """M u = b for balls, by Gauss after multiplication with an approximate inverse."""
    if not b:
        return []
    return [v for row in M.solve(arb_mat([[v] for v in b]), algorithm="precond").tolist() for v in row]


def make_flow(case: Case, arc, rows=None):
    """The flow of an arc of nsbench.reference.arcs."""
    if isinstance(case.problem, Complementarity):
        return ContactFlow(case, arc.held, arc.shut, rows)
    if isinstance(case.problem, Filippov):
        return SlidingFlow(case, arc.mode)
    raise ValueError(f"certificates know no {type(case.problem).__name__} systems")
