"""Check the inequalities behind the proven bounds in exact rational arithmetic.

Random contact graphs with rational unit directions (stereographic projection of rational points),
in the plane and in space, with redundant and repeated contacts; the sweep runs in the order of the
contacts, which are drawn at random. A holds for any such graph, packings or not. All inequalities
are squared where roots occur, so that nothing is rounded. Their names and proofs: docs/studies.md.

K, the norm of |A| - I, is irrational in general; the smallest (R x)_k / x_k of Collatz & Wielandt
gives a rational upper bound, with which the inequalities are as valid and hardly weaker.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

MAX_BODIES = 6
MAX_CONTACTS = 8
DENOMINATOR = 8  # of gaps and of the parameters of directions
DECAYS = (Fraction(21, 20), Fraction(11, 10), Fraction(5, 4))  # e^mu
POWER_STEPS = 30  # in doubles, for the vector of Collatz & Wielandt
Vector = list[Fraction]
Matrix = list[list[Fraction]]


@dataclass(frozen=True)
class Instance:
    """Pairs of bodies in contact, their Gram matrix, and two sets of gaps.

    dist: distances in the dual graph, -1 for none.
    """

    pairs: list[tuple[int, int]]
    gram: Matrix
    gaps: Vector
    other_gaps: Vector
    dist: list[list[int]]


def draw_instance(rng: np.random.Generator) -> Instance:
    """Draw a graph with rational directions, and gaps between -1 and 1, many of them -1 or 0."""
    dim = int(rng.integers(2, 4))
    bodies = int(rng.integers(2, MAX_BODIES + 1))
    everything = list(itertools.combinations(range(bodies), 2))
    count = int(rng.integers(1, MAX_CONTACTS + 1))
    pairs = [everything[int(rng.integers(len(everything)))] for _ in range(count)]
    directions = [_draw_direction(rng, dim) for _ in pairs]
    gram = [
        [_inner_product(p, u, q, v) for q, v in zip(pairs, directions, strict=True)]
        for p, u in zip(pairs, directions, strict=True)
    ]
    gaps = _draw_gaps(rng, count)
    return Instance(pairs, gram, gaps, _draw_gaps(rng, count), _distances(gram))


def _draw_direction(rng, dim) -> Vector:
    """Draw a rational unit vector: the stereographic projection of a rational point."""
    p = [Fraction(int(k), DENOMINATOR) for k in rng.integers(-16, 17, size=dim - 1)]
    square = sum(x * x for x in p)
    return [2 * x / (1 + square) for x in p] + [(1 - square) / (1 + square)]


def _inner_product(p, u, q, v) -> Fraction:
    """Inner product of two unit normals: +-<u, v> / 2 for each body that they share."""
    signs = sum((1 if a == b else -1) for a in range(2) for b in range(2) if p[a] == q[b])
    return Fraction(signs, 2) * sum(x * y for x, y in zip(u, v, strict=True))


def _draw_gaps(rng, count) -> Vector:
    special = rng.random() < 0.5
    low = -DENOMINATOR
    values = rng.integers(-1, 1, size=count) * DENOMINATOR if special else None
    values = rng.integers(low, DENOMINATOR + 1, size=count) if values is None else values
    return [Fraction(int(k), DENOMINATOR) for k in values]


def _body_distances(pairs, start) -> dict[int, int]:
    """Contacts on the shortest way from one body to every other one that it is joined to."""
    dist = {start: 0}
    queue = [start]
    for body in queue:
        for pair in pairs:
            if body in pair:
                other = pair[0] + pair[1] - body
                if other not in dist:
                    dist[other] = dist[body] + 1
                    queue.append(other)
    return dist


def _distances(gram) -> list[list[int]]:
    m = len(gram)
    out = []
    for start in range(m):
        dist = [-1] * m
        dist[start] = 0
        queue = [start]
        for k in queue:
            for j in range(m):
                if dist[j] < 0 and gram[k][j] != 0:
                    dist[j] = dist[k] + 1
                    queue.append(j)
        out.append(dist)
    return out


def sweep_exactly(gram: Matrix, gaps: Vector) -> tuple[Vector, Vector]:
    """Sweep in the order of the contacts; returns corrections c and gaps g' = g + A c."""
    m = len(gaps)
    c = [Fraction(0)] * m
    for k in range(m):
        c[k] = max(Fraction(0), -(gaps[k] + _dot(gram[k], c)))
    return c, [gaps[k] + _dot(gram[k], c) for k in range(m)]


def _dot(x: Vector, y: Vector) -> Fraction:
    return sum((a * b for a, b in zip(x, y, strict=True)), Fraction(0))


def _negative(x: Vector) -> Vector:
    return [max(-a, Fraction(0)) for a in x]


def _norm_above(matrix: Matrix) -> Fraction:
    """Rational upper bound of the norm of a symmetric non-negative matrix (Collatz & Wielandt)."""
    values = np.array([[float(a) for a in row] for row in matrix])
    x = np.ones(len(values))
    for _ in range(POWER_STEPS):
        x = x + values @ x
        x /= x.max()
    exact = [max(Fraction(float(v)).limit_denominator(1000), Fraction(1, 1000)) for v in x]
    return max(_dot(row, exact) / v for row, v in zip(matrix, exact, strict=True))


def check_instance(case: Instance) -> dict[str, bool]:
    """Return for each inequality whether it holds, exactly."""
    gram = case.gram
    m = len(gram)
    c, after = sweep_exactly(gram, case.gaps)
    v = _negative(case.gaps)
    left = _negative(after)
    minus = [
        [max(-gram[k][j], Fraction(0)) if j != k else Fraction(0) for j in range(m)]
        for k in range(m)
    ]
    kappa = max(sum(row) for row in minus)
    moved = _dot(c, [_dot(row, c) for row in gram])
    out = {
        "energy": _dot(c, c) + moved == -2 * _dot(c, case.gaps),
        "corrections": _dot(c, c) <= 4 * _dot(v, v),
        "reopened": all(
            left[k] <= sum((minus[k][j] * c[j] for j in range(k + 1, m)), Fraction(0))
            for k in range(m)
        ),
        "violations": _dot(left, left) <= 4 * kappa**2 * _dot(v, v),
        "column sums": sum(left) <= kappa * sum(c),
    }
    out["body weights"] = _check_body_weights(case, c, v)
    return out | _check_decay(case, c, left, minus)


def _check_body_weights(case, c, v) -> bool:
    """Check the second derivation of locality, with weights of bodies instead of contacts.

    |W c| <= 2 |W v| / (1 - K e^mu tanh mu), w_k^2 the mean of the squared weights of two bodies.
    """
    m = len(c)
    absolute = [
        [abs(case.gram[k][j]) if j != k else Fraction(0) for j in range(m)] for k in range(m)
    ]
    norm = _norm_above(absolute)
    holds = True
    for decay in DECAYS:
        room = 1 - norm * decay * (decay**2 - 1) / (decay**2 + 1)
        if room <= 0:
            continue
        for start in {body for pair in case.pairs for body in pair}:
            dist = _body_distances(case.pairs, start)
            near = [k for k, pair in enumerate(case.pairs) if pair[0] in dist]
            square = {
                k: (decay ** (-2 * dist[case.pairs[k][0]]) + decay ** (-2 * dist[case.pairs[k][1]]))
                / 2
                for k in near
            }
            own = sum((square[k] * c[k] ** 2 for k in near), Fraction(0))
            cause = sum((square[k] * v[k] ** 2 for k in near), Fraction(0))
            holds &= own * room**2 <= 4 * cause
    return holds


def _check_decay(case, c, left, minus) -> dict[str, bool]:
    """Check locality, the bounds of the largest violation and of the sum, and the ellipsoid."""
    gram = case.gram
    m = len(gram)
    absolute = [[abs(gram[k][j]) if j != k else Fraction(0) for j in range(m)] for k in range(m)]
    norm = _norm_above(absolute)
    other, _ = sweep_exactly(gram, case.other_gaps)
    change = [a - b for a, b in zip(c, other, strict=True)]
    cause = [a - b for a, b in zip(case.gaps, case.other_gaps, strict=True)]
    v = _negative(case.gaps)
    eps = max(v)
    names = ("locality", "largest violation", "difference", "sum", "ellipsoid")
    out = dict.fromkeys(names, True)
    for decay in DECAYS:
        room = 1 - norm * (decay - 1)
        spread = Fraction(0)
        for k, dist in enumerate(case.dist):
            near = [j for j in range(m) if dist[j] >= 0]
            w = {j: decay ** -dist[j] for j in near}
            size = lambda x, w=w: sum(((w[j] * x[j]) ** 2 for j in w), Fraction(0))
            own = sum(((minus[k][j] / w[j]) ** 2 for j in near), Fraction(0))
            shells = sum((w[j] ** 2 for j in near), Fraction(0))
            spread = max(spread, shells)
            if room > 0:
                out["locality"] &= size(c) * room**2 <= 4 * size(v)
                out["difference"] &= size(change) * room**2 <= 4 * size(cause)
                out["largest violation"] &= (left[k] * room) ** 2 <= 4 * own * shells * eps**2
            out["ellipsoid"] &= _inside_ellipsoid(gram, c, v, dist, decay)
        if room > 0:
            out["sum"] &= (sum(c) * room) ** 2 <= 4 * spread * sum(v) ** 2
    return out


def _inside_ellipsoid(gram, c, v, dist, decay) -> bool:
    """Check d . M d <= (W v) . d, the quadratic form of nsbench.studies.lemma.proven_bound."""
    near = [j for j in range(len(c)) if dist[j] >= 0]
    d = {j: c[j] * decay ** -dist[j] for j in near}
    form = sum((d[j] ** 2 for j in near), Fraction(0))
    for j, l in itertools.combinations(near, 2):
        ratio = decay ** abs(dist[j] - dist[l])
        entry = gram[j][l]
        form += entry * (ratio if entry < 0 else 1 / ratio) * d[j] * d[l]
    return form <= sum((d[j] * v[j] * decay ** -dist[j] for j in near), Fraction(0))


def count_violations(seed: int, first: int, last: int) -> dict[str, int]:
    """Check instances `first` to `last` - 1 of a seed; returns how often each inequality failed.

    The key "checked" counts the instances.
    """
    out: dict[str, int] = {"checked": 0}
    for k in range(first, last):
        result = check_instance(draw_instance(np.random.default_rng([seed, k])))
        out["checked"] += 1
        for name, holds in result.items():
            out[name] = out.get(name, 0) + (not holds)
    return out


def largest_ratio(seed: int, starts: int, steps: int) -> float:
    """Climb over gaps, order and directions for the largest |c| / (2 |v|) of a chain or a graph.

    A value above 1 would refute the first inequality. In doubles; a search for counterexamples.
    """
    best = 0.0
    for start in range(starts):
        rng = np.random.default_rng([seed, 1, start])
        bodies = int(rng.integers(3, 13))
        path = [(i, i + 1) for i in range(bodies - 1)]
        more = [tuple(sorted(rng.choice(bodies, 2, replace=False))) for _ in range(start % 4)]
        pairs = np.array(path + more)
        u = rng.normal(size=(len(pairs), 2))
        g = rng.uniform(-1.0, 0.2, len(pairs))
        rank = rng.random(len(pairs))
        value = _ratio(pairs, u, g, rank)
        for step in range(steps):
            scale = 0.5 * 0.01 ** (step / steps)
            tried = (
                u + scale * rng.normal(size=u.shape),
                g + scale * rng.normal(size=g.shape) * (rng.random(len(g)) < 0.3),
                np.where(rng.random(len(g)) < 0.1, rng.random(len(g)), rank),
            )
            new = _ratio(pairs, *tried)
            if new >= value:
                value = new
                u, g, rank = tried
        best = max(best, value)
    return best


def _ratio(pairs, u, g, rank) -> float:
    from nsbench.studies.packings.linear_sweep import sweep

    u = u / np.linalg.norm(u, axis=1)[:, None]
    normals = np.zeros((len(pairs), int(pairs.max()) + 1, 2))
    rows = np.arange(len(pairs))
    normals[rows, pairs[:, 0]] = -u / np.sqrt(2.0)
    normals[rows, pairs[:, 1]] = u / np.sqrt(2.0)
    flat = normals.reshape(len(pairs), -1)
    c = sweep(flat @ flat.T, np.argsort(rank), g).corrections
    v = np.linalg.norm(np.maximum(-g, 0.0))
    return float(np.linalg.norm(c) / (2.0 * v)) if v > 0.0 else 0.0
