"""The inequalities behind proven error bars, along motions in exact rational arithmetic.

Under a drift that is constant by phases, a point between flat walls moves along straight lines with
rational ends. x moves under the drift f, Y under f + rho, from two starts in S; w = Y - x.
Vectors and matrices are arrays of Fraction; rows of N have any length, on which nothing depends.
"""

from collections import Counter, namedtuple
from fractions import Fraction
from itertools import chain, combinations
from math import isqrt

import numpy as np
import pytest

from nsbench import Affine, Case, Complementarity, solve

SHARP = 10**30  # its inverse is the width of enclosures of square roots
System = namedtuple("System", "N b phases x y near")  # phases: (H, f, rho); near: near x, known
Piece = namedtuple("Piece", "t H x v q closed rho")  # q: the positive multipliers, by contact
size = lambda v: roots(v @ v)  # from below and from above


def roots(square):
    """Enclose the root of a rational number by two rational numbers, equal if it is one."""
    below = Fraction(isqrt(square.numerator * SHARP**2 // square.denominator), SHARP)
    return below, below if below * below == square else below + Fraction(1, SHARP)


def inverse_gram(N):
    """Return the inverse of N N^T; None where rows depend on one another."""
    A = np.hstack([N @ N.T, np.eye(len(N), dtype=int) * Fraction(1)])
    for c in range(len(N)):
        if A[c, c] == 0:  # of a semidefinite matrix: the whole row is
            return None
        A[c] /= A[c, c]
        for i in set(range(len(N))) - {c}:
            A[i] -= A[i, c] * A[c]
    return A[:, len(N) :]


def nearest(N, b, f):
    """Return v nearest to f with N v + b >= 0, and the positive ones of q in v = f + N^T q."""
    for some in map(list, chain(*(combinations(range(len(N)), m) for m in range(len(f) + 1)))):
        if (G := inverse_gram(N[some])) is not None:
            q = -G @ (N[some] @ f + b[some])
            v = f + q @ N[some]
            if min([0, *q, *(N @ v + b)]) == 0:
                return v, {k: a for k, a in zip(some, q, strict=True) if a > 0}


def motion(s, x, is_disturbed=False):
    """Return the straight pieces of the motion from x, under f + rho where it is disturbed."""
    pieces, t = [], Fraction(0)
    for H, f, rho in s.phases:
        end = t + H
        while t < end:
            g = s.N @ x + s.b
            on = np.flatnonzero(g == 0)
            v, q = nearest(s.N[on], 0 * s.b[on], f + rho if is_disturbed else f)
            u = s.N @ v
            dt = min([end - t, *(-g[k] / u[k] for k in range(len(g)) if g[k] > 0 > u[k])])
            closed = frozenset(k for k in on if u[k] == 0)
            pieces.append(Piece(t, dt, x, v, {on[k]: a for k, a in q.items()}, closed, rho))
            x, t = x + dt * v, t + dt
    return pieces


def at(pieces, t):
    p = next(p for p in pieces if t <= p.t + p.H)
    return p.x + (t - p.t) * p.v


def difference(one, two, first, last):
    """Return one - two at both times, and its integral between them."""
    nodes = sorted({first, last} | {p.t for p in (*one, *two) if first < p.t < last})
    w = [at(one, t) - at(two, t) for t in nodes]
    parts = [H * (a + b) / 2 for H, a, b in zip(np.diff(nodes), w[:-1], w[1:], strict=True)]
    return w[0], w[-1], sum(parts, 0 * w[0])


def groups(N, contacts):
    """Return the contacts in groups whose gradients are orthogonal to one another."""
    found = []
    for k in sorted(contacts):
        joined = [g for g in found if (N[g] @ N[k]).any()]
        found = [g for g in found if g not in joined] + [[*chain(*joined), k]]
    return found


def projection(N):
    """Return the projection on the span of the rows N."""
    basis = []
    for k in range(len(N)):
        basis += [k] if inverse_gram(N[[*basis, k]]) is not None else []
    return N[basis].T @ inverse_gram(N[basis]) @ N[basis]


def reached(s, p, w):
    """Return what acts on Y or x along a piece of Y: groups, projections on them, sizes there."""
    contacts = set(p.closed)
    while True:
        found = groups(s.N, contacts)
        spans = [projection(s.N[g]) for g in found]
        most = [size(P @ w)[1] + p.H * size(P @ p.rho)[1] for P in spans]
        whole = np.array([w, w + p.H * p.rho])
        ends = (whole - sum(whole @ P for P in spans)) @ s.N.T
        gaps = np.array([p.x, p.x + p.H * p.v]) @ s.N.T + s.b
        far = (np.array([[size(P @ n)[1] for P in spans] for n in s.N]) * most).sum(axis=1)
        if (more := set(np.flatnonzero(gaps.min(axis=0) <= ends.max(axis=0) + far))) <= contacts:
            return found, spans, most
        contacts |= more


def kappa(N, group, p):
    """Return how fast a group takes off errors along a piece of Y, rounded down."""
    G = inverse_gram(N[group])
    if G is None or not all(k in p.q and k in p.closed for k in group):
        return 0
    return roots(min(p.q[k] ** 2 / G[i, i] for i, k in enumerate(group)))[0]


def findings(s, p, x, rate=1):
    """Yield what fails of the split bound on a piece p of Y, by name, and which groups are held."""
    w, new, total = difference([p], x, p.t, p.t + p.H)
    found, spans, most = reached(s, p, w)
    acting = {k for o in x if o.t < p.t + p.H and p.t < o.t + o.H for k in o.q}
    yield from ["reach"] * (not acting <= set(chain(*found)))
    yield from ["norm"] * (size(new)[0] > size(w)[1] + p.H * size(p.rho)[1])
    start, end, rho = (v - sum(P @ v for P in spans) for v in (w, new, p.rho))
    yield from ["tangent"] * any(end - start - p.H * rho)
    lack = total - p.H * start - p.H**2 / 2 * rho
    yield from ["integral"] * (size(lack)[0] > p.H * roots(sum(r * r for r in most))[1])
    for P, group in zip(spans, found, strict=True):
        left = max(0, size(P @ w)[1] - rate * p.H * (pull := kappa(s.N, group, p)))
        yield from ["group"] * (size(P @ new)[0] > left + p.H * size(P @ p.rho)[1])
        yield from [f"held {len(group)}"] * (pull > 0 and any(P @ w))


def system(seed, n):
    """Draw walls around the origin, four phases of a drift, and starts in S; even ones no rho."""
    rng = np.random.default_rng(seed)
    draw = lambda top, unit, *m: rng.integers(-top, top + 1, (*m, n)) * Fraction(1, unit)
    N = draw(4, 1, n + 2)
    N = N[N.any(axis=1)]
    b = rng.integers(1, 5, len(N)) * Fraction(1, 4)
    phases = [(Fraction(1, 2), draw(6, 2), seed % 2 * draw(2, 20)) for _ in range(4)]
    x = nearest(N, b, draw(6, 5))[0]
    return System(N, b, phases, x, nearest(N, b, x + draw(4, 16))[0], x + draw(2, 50))


@pytest.mark.parametrize("n, rate", [(2, 1), (3, 1), (2, Fraction(3, 2))])
def test_errors_keep_to_the_split_bound_and_no_faster_rate(n, rate):
    seen = Counter()
    for s in (system(seed, n) for seed in range(60)):
        x = motion(s, s.x)
        seen.update(c for p in motion(s, s.y, True) for c in findings(s, p, x, rate))
    assert seen.keys() == {f"held {m + 1}" for m in range(n)} | ({"group"} if rate > 1 else set())
    assert min(seen.values()) >= 4


@pytest.mark.parametrize("n", [2, 3])
def test_a_second_solution_keeps_the_direction_of_the_error(n):
    """X starts where x is known to be near and moves under f + rho: Y - X is near Y - x."""
    turned = 0
    for s in (system(seed, n) for seed in range(60)):
        start = nearest(s.N, s.b, s.near)[0]
        x, X, Y = motion(s, s.x), motion(s, start, True), motion(s, s.y, True)
        bound = size(s.near - s.x)[1] + size(start - s.near)[1]
        for p in X:
            end = p.t + p.H
            bound += p.H * size(p.rho)[1]
            w, delta = at(Y, end) - at(x, end), at(Y, end) - at(X, end)
            assert size(w - delta)[0] <= bound
        # where the drift reads the state by a factor Lip, its integral lacks Lip times this
        assert size(difference(X, x, Fraction(0), end)[2])[0] <= end * bound
        turned += [p.q.keys() for p in Y] != [p.q.keys() for p in x]
    assert turned > 30


@pytest.mark.parametrize("n, seed, method", [(2, 3, "pbd"), (2, 3, "catching_up"), (3, 2, "pbd")])
def test_a_bound_is_above_errors_that_are_known_exactly(n, seed, method):
    """The last coordinate, without walls, grows by the sum of the others: methods err in it."""
    s = system(seed, n)
    f = s.phases[0][1]
    x = motion(s._replace(phases=[(2, f, 0 * f)]), s.x)
    still = [x[0]._replace(H=2, x=0 * f, v=0 * f)]
    paths = [difference(x, still, Fraction(0), Fraction(k, 4)) for k in range(9)]
    truth = np.array([[*end, sum(total)] for _, end, total in paths], float)
    J = np.append(np.zeros((n, n + 1)), [[1.0] * n + [0.0]], axis=0)
    c = np.append(f, 0).astype(float)
    drift = lambda xp: lambda t, x: xp.asarray(J) @ x + xp.asarray(c)
    walls = Affine(A=np.pad(s.N.astype(float), ((0, 0), (0, 1))), b=s.b.astype(float))
    case = Case("exact", Complementarity(drift, (walls,)), truth[0], np.arange(9) / 4)
    traj = solve(case, method, h=0.1)
    error = np.linalg.norm(traj.x - truth, axis=1)
    off = np.linalg.norm(traj.reaction - (truth - truth[0] - np.outer(case.t, c)) * J[-1], axis=1)
    assert traj.bound.is_proven and error.max() > 1e-2
    assert np.all(traj.bound.state >= error - 1e-12)
    assert np.all(traj.bound.reaction >= off - 1e-12)
