"""Packings of touching discs and spheres, and the Gram matrix of their contacts.

Bodies i = 1 .. n with centres x_i in R^d and radii r_i; contact k between i and j where
|x_i - x_j| = r_i + r_j. The unit normal of contact k is n_k = (u, -u) / sqrt(2) in the coordinates
of the two bodies, u = (x_j - x_i) / |x_j - x_i|, and

    A = (<n_k, n_l>):  1 on the diagonal, and for two contacts of one body +- <u_k, u_l> / 2,

-cos(angle) / 2 ... seen from the shared body: -1/2 for two contacts in line. A is positive
semidefinite, singular where contacts are redundant. Two contacts are neighbours in the dual graph
if they share a body.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

TOUCHING = 1e-9  # a gap below this fraction of the distance is closed
ORTHOGONAL = 1e-12  # entries of A below this are rounding of zero
CLEARANCE = 0.05  # between spheres that do not touch, in units of the smallest radius
MAX_ATTEMPTS = 20_000  # to place all spheres of a packing
MAX_ATTEMPTS_OF_SEED = 50  # to place one disc that has a seed of its own


@dataclass(frozen=True)
class ContactGraph:
    """A packing: name, centres (n, d), radii (n,), pairs (m, 2) with the smaller index first."""

    name: str
    centres: np.ndarray
    radii: np.ndarray
    pairs: np.ndarray

    @property
    def gram(self) -> np.ndarray:
        """Compute the Gram matrix A (m, m) of the unit normals."""
        n, d = self.centres.shape
        normals = np.zeros((len(self.pairs), n, d))
        rows = np.arange(len(self.pairs))
        i, j = self.pairs.T
        u = self.centres[j] - self.centres[i]
        u /= np.linalg.norm(u, axis=1)[:, None] * np.sqrt(2.0)
        normals[rows, j] = u
        normals[rows, i] = -u
        flat = normals.reshape(len(rows), -1)
        gram = flat @ flat.T
        gram[np.abs(gram) < ORTHOGONAL] = 0.0
        np.fill_diagonal(gram, 1.0)
        return gram

    @property
    def max_degree(self) -> int:
        """Return the largest number of contacts of one body."""
        return int(np.bincount(self.pairs.ravel()).max())

    def distances(self) -> np.ndarray:
        """Compute the distances (m, m) in the dual graph; inf between components."""
        return graph_distances(self.gram)


def graph_distances(gram: np.ndarray) -> np.ndarray:
    """Compute the number of non-zero entries of A on the shortest way between two contacts."""
    m = len(gram)
    near = (gram != 0.0) & ~np.eye(m, dtype=bool)
    distance = np.where(np.eye(m, dtype=bool), 0.0, np.inf)
    reached = np.eye(m, dtype=bool)
    # breadth-first search from all contacts at once
    for step in range(1, m):
        new = (reached @ near) & ~reached
        if not new.any():
            break
        distance[new] = step
        reached |= new
    return distance


def _packing(name: str, centres, radii=None) -> ContactGraph:
    """Build a packing with all contacts between spheres that touch."""
    centres = np.asarray(centres, dtype=float)
    radii = np.ones(len(centres)) if radii is None else np.asarray(radii, dtype=float)
    i, j = np.triu_indices(len(centres), 1)
    reach = radii[i] + radii[j]
    gap = np.linalg.norm(centres[i] - centres[j], axis=1) - reach
    closed = np.abs(gap) <= TOUCHING * reach
    return ContactGraph(name, centres, radii, np.stack((i[closed], j[closed]), axis=1))


def chain(n: int) -> ContactGraph:
    """Build n equal discs in a row."""
    return _packing(f"chain{n}", np.stack((2.0 * np.arange(n), np.zeros(n)), axis=1))


def hexagon(rings: int) -> ContactGraph:
    """Build a hexagonal patch: one disc with `rings` rings around it, 3 r (r + 1) + 1 discs."""
    rows = [
        (q + 0.5 * s, s)
        for s in range(-rings, rings + 1)
        for q in range(max(-rings, -rings - s), min(rings, rings - s) + 1)
    ]
    centres = np.array(rows, dtype=float).reshape(-1, 2) * [2.0, np.sqrt(3.0)]
    return _packing(f"hex{len(rows)}", centres)


def star(arms: int, length: int) -> ContactGraph:
    """Build a tree: straight arms of `length` discs from one disc, 2 to 5 of them."""
    angles = 2.0 * np.pi * np.arange(arms) / arms
    away = np.stack((np.cos(angles), np.sin(angles)), axis=1)
    steps = 2.0 * np.arange(1, length + 1)
    centres = [np.zeros(2), *(s * u for u in away for s in steps)]
    return _packing(f"tree{arms}x{length}", centres)


def flower(petals: int) -> ContactGraph:
    """Build a disc with `petals` touching smaller or larger ones around it, a closed ring."""
    ratio = np.sin(np.pi / petals) / (1.0 - np.sin(np.pi / petals))
    angles = 2.0 * np.pi * np.arange(petals) / petals
    ring = (1.0 + ratio) * np.stack((np.cos(angles), np.sin(angles)), axis=1)
    radii = np.r_[1.0, np.full(petals, ratio)]
    return _packing(f"flower{petals}", np.vstack((np.zeros(2), ring)), radii)


def close_packed(count: int) -> ContactGraph:
    """Build equal spheres of the face-centred cubic packing: the `count` nearest to the origin."""
    span = range(-3, 4)
    points = np.array([p for p in itertools.product(span, span, span) if sum(p) % 2 == 0])
    nearest = np.argsort((points**2).sum(axis=1), kind="stable")[:count]
    return _packing(f"sphere{count}", points[nearest] * np.sqrt(2.0))


def grow(
    n: int, seed: int, loops: float = 0.5, spread: float = 0.0, dim: int = 2, name: str = ""
) -> ContactGraph:
    """Grow a random kissing graph of n spheres.

    Each new sphere touches one sphere in a random direction, or, with probability `loops`, `dim`
    spheres at once; it keeps a clearance from all others. radii: uniform in [1, 1 + spread].
    Raises ValueError where no place is found.
    """
    rng = np.random.default_rng([seed, n, dim])
    radii = 1.0 + spread * rng.random(n)
    growth = _Growth(radii, loops, dim)
    for _ in range(MAX_ATTEMPTS):
        if len(growth.centres) == n:
            break
        growth.try_next(rng)
    return growth.finish(name or f"kissing{n}s{seed}")


def grow_from(seeds: list[int], loops: float = 0.5, name: str = "grown") -> ContactGraph:
    """Grow a kissing graph of equal discs, the place of each drawn with a seed of its own.

    To change one seed moves one disc, and those that touch it. Raises ValueError where no place is
    found.
    """
    growth = _Growth(np.ones(len(seeds)), loops, 2)
    for k, seed in enumerate(seeds[1:], 1):
        rng = np.random.default_rng([seed, k])
        for _ in range(MAX_ATTEMPTS_OF_SEED):
            if growth.try_next(rng):
                break
    return growth.finish(name)


class _Growth:
    """A kissing graph that grows sphere by sphere: centres (k, d), touching pairs."""

    def __init__(self, radii: np.ndarray, loops: float, dim: int):
        self.radii = radii
        self.loops = loops
        self.centres = np.zeros((1, dim))
        self.pairs: list[tuple[int, int]] = []

    def try_next(self, rng: np.random.Generator) -> bool:
        """Propose a place for the next sphere and take it if it is clear of all others."""
        place, touched = _propose(self.centres, self.radii, self.loops, rng)
        if place is None:
            return False
        k = len(self.centres)
        gaps = np.linalg.norm(self.centres - place, axis=1) - self.radii[:k] - self.radii[k]
        gaps[touched] = np.inf
        if gaps.min() < CLEARANCE:
            return False
        self.pairs += [(i, k) for i in sorted(touched)]
        self.centres = np.vstack((self.centres, place))
        return True

    def finish(self, name: str) -> ContactGraph:
        """Return the packing. Raises ValueError where spheres have found no place."""
        k = len(self.centres)
        if k < len(self.radii):
            raise ValueError(f"no place for sphere {k + 1} of {len(self.radii)}")
        return ContactGraph(name, self.centres, self.radii, np.array(self.pairs).reshape(-1, 2))


def _propose(centres, radii, loops, rng):
    """Propose the place of the next sphere and the spheres that it touches; (None, []) if none."""
    count, dim = centres.shape
    reach = radii[:count] + radii[count]
    first = int(rng.integers(count))
    if count < dim or rng.random() >= loops:
        direction = rng.normal(size=dim)
        direction /= np.linalg.norm(direction)
        return centres[first] + reach[first] * direction, [first]
    near = np.argsort(np.linalg.norm(centres - centres[first], axis=1), kind="stable")
    # the nearest few, so that the new sphere can reach all of them
    others = rng.choice(near[1 : 2 * dim + 2], size=dim - 1, replace=False)
    touched = [first, *map(int, others)]
    return _touching_all(centres[touched], reach[touched], rng), touched


def _touching_all(c, reach, rng):
    """Place a sphere at the given distances from d centres (d, d): one of two places, or None."""
    # |x - c_i|^2 = reach_i^2: differences are linear and leave a line x = base + t w
    rows = 2.0 * (c[1:] - c[0])
    rhs = (reach[0] ** 2 - reach[1:] ** 2) + (c[1:] ** 2).sum(axis=1) - (c[0] ** 2).sum()
    base = np.linalg.lstsq(rows, rhs, rcond=None)[0]
    w = np.linalg.svd(rows)[2][-1]
    b = w @ (base - c[0])
    square = b * b - ((base - c[0]) ** 2).sum() + reach[0] ** 2
    if square <= 0.0:
        return None
    return base + (-b + rng.choice([-1.0, 1.0]) * np.sqrt(square)) * w
