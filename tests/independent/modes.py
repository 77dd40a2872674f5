"""The modes of the three classes of systems, by enumeration: active sets, sides and sliding,
circuits of diodes.

Each class gives what `engine.march` asks for: `ids`, `parts` and `decide`. Functions of time and
state return `mpf`.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import mpmath as m
from engine import EPS, ZERO, columns, march
from mpmath import mpf


def dot(a, b):
    return sum(u * v for u, v in zip(a, b, strict=True))


def solve(M, r):
    """M^-1 r as a list."""
    return [r[0] / M[0][0]] if len(r) == 1 else list(m.lu_solve(m.matrix(M), m.matrix(r)))


def subsets(items):
    return (s for r in range(len(items) + 1) for s in itertools.combinations(items, r))


# ---------------------------------------------------------------- constraints
@dataclass(frozen=True)
class Gap:
    """A gap g(t, x) >= 0 with its gradient (t, x) -> list and its partial derivative in time."""

    g: Callable
    grad: Callable
    rate: Callable = lambda t, x: mpf(0)


def affine(a, b=0, db=None):
    """a x + b, b a number or a function of time with derivative db."""
    a = [mpf(v) for v in a]
    return Gap(
        lambda t, x: dot(a, x) + (b(t) if callable(b) else mpf(b)),
        lambda t, x: a,
        (lambda t, x: db(t)) if db else Gap.rate,
    )


def eye(n):
    """Floors at 0 under n coordinates."""
    return [affine([int(i == k) for i in range(n)]) for k in range(n)]


def length(v):
    return m.sqrt(sum(c * c for c in v))


def dist(i, j, d, n, dim=2, sign=1):
    """sign (|xi - xj| - d) in n coordinates."""
    diff = lambda x: [x[i * dim + k] - x[j * dim + k] for k in range(dim)]

    def grad(t, x):
        v = diff(x)
        out = [mpf(0)] * n
        for k in range(dim):
            out[i * dim + k] += sign * v[k] / length(v)
            out[j * dim + k] -= sign * v[k] / length(v)
        return out

    return Gap(lambda t, x: sign * (length(diff(x)) - mpf(d)), grad)


def anchor(i, a, da, d, n, dim=2, sign=1):
    """sign (|xi - a(t)| - d) in n coordinates; da is the velocity of the anchor."""
    diff = lambda t, x: [x[i * dim + k] - p for k, p in enumerate(a(t))]

    def grad(t, x):
        v = diff(t, x)
        out = [mpf(0)] * n
        out[i * dim : (i + 1) * dim] = [sign * c / length(v) for c in v]
        return out

    return Gap(
        lambda t, x: sign * (length(diff(t, x)) - mpf(d)),
        grad,
        lambda t, x: -dot(grad(t, x)[i * dim : (i + 1) * dim], da(t)),
    )


# ---------------------------------------------------------------- complementarity
@dataclass(frozen=True)
class Contacts:
    """x' = f + sum lam_k d_k, 0 <= g_k _|_ lam_k >= 0, with d_k the gradient of g_k, or a given
    direction. f per era."""

    f: Sequence
    gaps: Sequence
    ids: Sequence
    directions: Sequence | None = None

    def push(self, k, t, x):
        return self.directions[k] if self.directions else self.gaps[k].grad(t, x)

    def rate(self, k, t, x, v):
        """dg_k/dt at the velocity v."""
        return dot(self.gaps[k].grad(t, x), v) + self.gaps[k].rate(t, x)

    def lam(self, active, era, t, x):
        """Multipliers that hold the active gaps, and the velocity."""
        v = self.f[era](t, x)
        push = [self.push(k, t, x) for k in active]
        if not active:
            return [], v
        M = [[dot(self.gaps[k].grad(t, x), p) for p in push] for k in active]
        lam = solve(M, [-self.rate(k, t, x, v) for k in active])
        return lam, [
            c + sum(q * p[i] for q, p in zip(lam, push, strict=True)) for i, c in enumerate(v)
        ]

    def all_lam(self, active, era, t, x):
        found = dict(zip(active, self.lam(active, era, t, x)[0], strict=True))
        return [found.get(k, mpf(0)) for k in range(len(self.gaps))]

    def parts(self, active, era, t, x):
        guards = [
            ("release", lambda t, x, q=q: self.lam(active, era, t, x)[0][q])
            for q in range(len(active))
        ]
        for k in set(range(len(self.gaps))) - set(active):
            slack = (
                100 * EPS if self.gaps[k].g(t, x) < ZERO else mpf(0)
            )  # a redundant row of the active set stays at 0
            guards.append(("contact", lambda t, x, k=k, slack=slack: self.gaps[k].g(t, x) + slack))
        return (
            lambda t, x: self.lam(active, era, t, x)[1],
            partial(self.all_lam, active, era),
            guards,
        )

    def decide(self, t, x, mode, tags, era):
        """The first set of closed gaps, the smallest first, that pulls at none and lets none open
        backwards."""
        closed = [k for k, c in enumerate(self.gaps) if c.g(t, x) < ZERO]
        for active in subsets(closed):
            try:
                lam, v = self.lam(active, era, t, x)
            except ZeroDivisionError:  # dependent rows
                continue
            if all(-ZERO <= q <= 10**20 for q in lam) and all(
                self.rate(k, t, x, v) >= -ZERO for k in closed
            ):
                return active, changes(self.ids, mode or (), active)
        raise RuntimeError(f"no active set at t = {m.nstr(t, 20)}")


def changes(ids, old, new):
    return [("contact", ids[k]) for k in new if k not in old] + [
        ("release", ids[k]) for k in old if k not in new
    ]


def complementarity(f, gaps, x0, ts, H=0.05, ids=None, breaks=(), directions=None):
    """The Path; f one function or one per era; ids (0, k) unless given."""
    f = f if isinstance(f, list) else [f] * (len(breaks) + 1)
    directions = [[mpf(v) for v in d] for d in directions] if directions else None
    return march(Contacts(f, gaps, ids or columns(len(gaps)), directions), x0, ts, H, breaks)


# ---------------------------------------------------------------- Filippov
@dataclass(frozen=True)
class Sides:
    """x' = f(t, x, s), multilinear in the signs s of d switching functions; a mode is a string of
    +, - and s (sliding)."""

    f: Callable
    switch: Callable
    dswitch: Callable
    ids: Sequence

    def signs(self, mode, t, x):
        """The signs that hold the sliding surfaces, by Newton; a coordinate of a multilinear map
        has exact differences."""
        s = [mpf({"+": 1, "-": -1, "s": 0}[c]) for c in mode]
        slide = [k for k, c in enumerate(mode) if c == "s"]
        if not slide:
            return s
        grad, rate = self.dswitch(t, x)
        residual = lambda s: [dot(grad[k], v) + rate[k] for v in [self.f(t, x, s)] for k in slide]
        for _ in range(60):
            r = residual(s)
            columns = [
                [a - b for a, b in zip(residual([*s[:k], s[k] + 1, *s[k + 1 :]]), r, strict=True)]
                for k in slide
            ]
            ds = solve([list(row) for row in zip(*columns, strict=True)], [-v for v in r])
            for k, d in zip(slide, ds, strict=True):
                s[k] += d
            if len(slide) == 1 or max(abs(d) for d in ds) < mpf(10) ** -40:
                break
        return s

    def weights(self, mode, t, x):
        return [(1 + v) / 2 for v in self.signs(mode, t, x)]

    def parts(self, mode, era, t, x):
        guards = []
        for k, c in enumerate(mode):
            if c == "s":
                guards.append((("+", k), lambda t, x, k=k: 1 - self.weights(mode, t, x)[k]))
                guards.append((("-", k), lambda t, x, k=k: self.weights(mode, t, x)[k]))
            else:
                guards.append((None, lambda t, x, k=k, q=int(c + "1"): q * self.switch(t, x)[k]))
        return (
            lambda t, x: self.f(t, x, self.signs(mode, t, x)),
            partial(self.weights, mode),
            guards,
        )

    def consistent(self, mode, t, x, free):
        """Whether the surfaces met are left on the side of the mode, or slid along with weights in
        [0, 1]."""
        try:
            s = self.signs(mode, t, x)
        except ZeroDivisionError:
            return False
        grad, rate = self.dswitch(t, x)
        v = self.f(t, x, s)
        speed = {k: dot(grad[k], v) + rate[k] for k in free}
        return all(
            abs(s[k]) < 1 + ZERO if mode[k] == "s" else int(mode[k] + "1") * speed[k] >= ZERO
            for k in free
        )

    def decide(self, t, x, mode, tags, era):
        """The one consistent mode; a surface whose weight has just reached its end is left on that
        side."""
        c = self.switch(t, x)
        left = {tag[1]: tag[0] for tag in tags if tag}
        free = [k for k, v in enumerate(c) if abs(v) < ZERO and k not in left]
        found = []
        for sides in itertools.product("s+-", repeat=len(free)):
            trial = list(mode or ("+" if v > 0 else "-" for v in c))
            for k, side in [*zip(free, sides, strict=True), *left.items()]:
                trial[k] = side
            if self.consistent(trial, t, x, free):
                found.append("".join(trial))
        if len(found) != 1:
            raise RuntimeError(f"modes {found} at t = {m.nstr(t, 20)} from {mode}")
        kind = lambda a, b: "enter" if b == "s" else "exit" if a == "s" else "cross"
        new = found[0]
        return new, [
            (kind(a, b), self.ids[k])
            for k, (a, b) in enumerate(zip(mode or new, new, strict=True))
            if a != b
        ]


def const(*rows):
    """Constant gradients of surfaces that stand, as `dswitch`."""
    return lambda t, x: ([[mpf(v) for v in r] for r in rows], [mpf(0)] * len(rows))


def filippov(f, switch, dswitch, x0, ts, d=1, H=0.05):
    """The Path; impulses are the integrals of the weights of the positive sides."""
    return march(Sides(f, switch, dswitch, columns(d)), x0, ts, H)


# ---------------------------------------------------------------- circuits with D of full rank on
# the sets met
@dataclass(frozen=True)
class Circuit:
    """x' = A x + B lam + u, 0 <= w = C x + D lam + q _|_ lam >= 0."""

    A: Sequence
    B: Sequence
    C: Sequence
    D: Sequence
    u: Callable
    q: Callable
    ids: Sequence

    def lam(self, active, t, x):
        """Of the active set: lam_a = -D_aa^-1 (C x + q)_a, else 0."""
        out = [mpf(0)] * len(self.D)
        q = self.q(t)
        if active:
            found = solve(
                [[self.D[a][b] for b in active] for a in active],
                [-dot(self.C[k], x) - q[k] for k in active],
            )
            for k, v in zip(active, found, strict=True):
                out[k] = v
        return out

    def w(self, active, t, x):
        lam = self.lam(active, t, x)
        q = self.q(t)
        return [dot(c, x) + dot(d, lam) + v for c, d, v in zip(self.C, self.D, q, strict=True)]

    def velocity(self, active, t, x):
        lam = self.lam(active, t, x)
        return [
            dot(a, x) + dot(b, lam) + v for a, b, v in zip(self.A, self.B, self.u(t), strict=True)
        ]

    def parts(self, active, era, t, x):
        guards = [
            (k, lambda t, x, k=k, f=self.lam if k in active else self.w: f(active, t, x)[k])
            for k in range(len(self.D))
        ]
        return partial(self.velocity, active), partial(self.lam, active), guards

    def decide(self, t, x, mode, tags, era):
        """The diodes whose guards fell change; the first set is the first that fits."""
        if mode is None:
            for s in subsets(range(len(self.D))):
                if min(self.lam(s, t, x)) >= 0 and min(self.w(s, t, x)) >= -ZERO:
                    return s, []
        new = tuple(sorted(set(mode) ^ set(tags)))
        return new, changes(self.ids, mode, new)


def circuit(A, B, C, D, u, q, x0, ts, H=0.05):
    """The Path of an LCS."""
    A, B, C, D = ([[mpf(v) for v in r] for r in M] for M in (A, B, C, D))
    return march(Circuit(A, B, C, D, u, q, columns(len(D))), x0, ts, H)
