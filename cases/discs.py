"""Discs: n hard unit discs from a random start, drawn together, turned and pushed about; or in a full box.

    x_i' = -x_i + w J x_i + e_i + contact forces,   g_ij = |x_i - x_j| - 2 >= 0      (free)
    x_i' =  u_i + contact and wall forces,          the same and four walls           (box)

e_i: fixed random vectors of length `kick`, so that the cluster is asymmetric and, turning, keeps changing contacts;
u_i: fixed random unit vectors, which keep nearly every disc of the box in contact. (A plain pull to the origin
alone is a poor benchmark: few contacts, all of one kind.)

The start is a jittered triangular lattice, numbered at random (labels = "random") or row by row ("rows"; fast
neighbour searches like it). No pair can be nearer than 2 + margin: neighbours in the lattice are a apart and each is
moved by at most (a - 2 - margin) / 2. It is built in O(n) and pairs are never listed.

No closed form. For n = 3, 10, 30 (seed 0) the solution has 3, about 20, about 130 events, nearly all of them by
t = 0.6 while the cluster closes up; then it turns. Closed clusters are redundant: 10 discs end with 18 contacts, one
more than can be independent.
"""
import numpy as np

from nsbench import Affine, Case, Complementarity, Distance

SUITES = {"smoke": [{"n": 3}], "standard": [{"n": 3}, {"n": 10}, {"n": 30}],
          "full": [{"n": 30, "seed": 1}, {"n": 100}, {"n": 100, "box": True}]}
SHOWN = ("n", "seed")
SPACING = 2.8                        # of the free start: gaps of a few tenths of a radius, closed within T
ROW = 0.75 ** 0.5                     # height of a row of the lattice
TIGHT = np.pi / 12 ** 0.5            # area fraction of touching discs on the lattice


def lattice(columns, rows):
    """Points of the triangular lattice of spacing 1, row by row: (rows * columns, 2)."""
    j, i = np.divmod(np.arange(rows * columns), columns)
    return np.stack((i + 0.5 * (j % 2), ROW * j), axis=1)


def directions(rng, n):
    angle = 2 * np.pi * rng.random(n)
    return np.stack((np.cos(angle), np.sin(angle)), axis=1)


def jitter(rng, n, reach):
    """Random vectors of length at most `reach`, spread evenly over the disc."""
    return reach * np.sqrt(rng.random(n))[:, None] * directions(rng, n)


def scattered(rng, n):
    """n lattice sites nearest to a random point, jittered, with their mean off the origin."""
    side = int(np.ceil(np.sqrt(n / ROW))) + 4
    sites = lattice(side, side)
    centre = sites.mean(axis=0) + rng.random(2)
    nearest = np.argsort(np.sum((sites - centre) ** 2, axis=1), kind="stable")[:n]
    x = SPACING * (sites[np.sort(nearest)] - centre)
    return x + jitter(rng, n, 0.5 * (SPACING - 2.0) * 0.98)


def packed(rng, n, packing):
    """Places on the lattice of that area fraction, and the box (width, height) it just fits into."""
    a = 2.0 * np.sqrt(TIGHT / packing)
    columns = max(1, round(np.sqrt(n * ROW)))
    rows = -(-n // columns)
    room = 0.5 * (a - 2.0) * 0.98
    box = a * np.array([columns - (0.5 if rows > 1 else 1.0), ROW * (rows - 1)]) + 2.0 + 2 * room
    return a * lattice(columns, rows)[:n] + 1.0 + room + jitter(rng, n, room), box


def walls(n, box):
    """x >= 1, y >= 1, x <= width - 1, y <= height - 1 of every disc; 4 n rows, one entry each."""
    from scipy.sparse import csr_array
    i = np.arange(2 * n)
    A = csr_array((np.repeat([1.0, -1.0], 2 * n), np.concatenate((i, i)), np.arange(4 * n + 1)), shape=(4 * n, 2 * n))
    return Affine(A, np.concatenate((np.full(2 * n, -1.0), np.tile(box - 1.0, n))))


def make(n: int = 30, seed: int = 0, w: float = 0.5, kick: float = 0.3, box: bool = False, packing: float = 0.8,
         labels: str = "random") -> Case:
    """n discs, w and kick of the free drift, packing the area fraction in the box (less near walls)."""
    if n < 1:
        raise ValueError(f"n is {n!r}; at least 1 disc")
    if not (isinstance(n, int) and n <= 10_000_000):
        raise ValueError(f"n is {n!r}; a whole number of at most 10 million discs (about {2e-6 * float(n):.0f} GB of samples)")
    if labels not in ("random", "rows"):
        raise ValueError(f"labels is {labels!r}; one of random, rows")
    if not 0 < packing < TIGHT:
        raise ValueError(f"packing is {packing!r}; an area fraction below {TIGHT:.4f}, that of touching discs")
    rng = np.random.default_rng(seed)
    places, size = packed(rng, n, packing) if box else (scattered(rng, n), None)
    if labels == "random":
        places = places[rng.permutation(n)]
    push = ((1.0 if box else kick) * directions(rng, n)).ravel()
    turn = w * np.tile([-1.0, 1.0], n)

    def free(xp):
        def f(t, x):
            return push - x + turn * x.reshape((-1, 2))[:, ::-1].flatten()
        return f

    def boxed(xp):
        def f(t, x):
            return push + 0.0 * x
        return f

    hard = Distance(d=2.0)
    return Case(
        name="discs",
        problem=Complementarity(boxed if box else free, (hard, walls(n, size)) if box else (hard,)),
        x0=places.ravel(),
        t=np.linspace(0.0, 3.0, 21),
        substeps=16, also=("pbd[order=reverse]",), radius=1.0, tags=("seed",),
    )
