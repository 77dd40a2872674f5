"""Draw particles of one state: discs, contacts, links, anchors, walls.

The functions without an underscore are shared with nsbench.report.scenes.plane.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from nsbench.case import Case
from nsbench.compilation.factories import as_numpy
from nsbench.problem import Affine, Distance

# Okabe & Ito (2008), readable with the common colour blindnesses
BLUE = "#0072B2"
SKY = "#56B4E9"
RED = "#D55E00"
BLACK = "#1c1b1a"
GREY = "#9a968d"  # thin lines
FORBIDDEN = "#e4e0d8"  # the region g < 0
MAX_DISCS = 1500  # in one panel: more are neither visible at 320 px nor a small file
MAX_WALLS = 40  # more distinct rows are not walls
CONTOUR_POINTS = 121  # along each axis, for contours of the forbidden region
CONTACT_TOLERANCE = 2e-3  # a gap below this fraction of a disc or link is drawn as contact
Group = tuple[int, int, int]  # first entry of the state, dimension, number of particles


def particle_groups(case: Case) -> dict:
    """Return the groups of particles of a case: (start, dim, count) -> radius.

    The radius is None, a number or an array (count,).
    """
    out = {}
    for c in case.problem.constraints:
        if isinstance(c, Distance):
            key = (c.start, c.dim, c.particles(case.n))
            radius = c.radii if c.radii is not None else c.d / 2 if c.all_pairs else None
            out[key] = radius if radius is not None else out.get(key, case.radius)
    return out


def particle_centres(x: np.ndarray, key: Group) -> np.ndarray:
    """Return the centres (count, dim) of a group in the state x (n,)."""
    start, dim, count = key
    return x[start : start + dim * count].reshape(count, dim)


def anchor_points(c: Distance, t: float) -> np.ndarray:
    """Return the anchors (m, dim) of a family at time t."""
    return np.asarray(
        as_numpy(c.anchors)(t) if callable(c.anchors) else c.anchors, dtype=float
    ).reshape(-1, c.dim)


def drawing_extent(case: Case, frames: list, kind: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the lowest and the highest corner (2,) of all that the frames show."""
    low = np.full(2, np.inf)
    high = np.full(2, -np.inf)

    def take(p: np.ndarray, r: float | np.ndarray = 0.0) -> None:
        nonlocal low, high
        p = np.asarray(p)[:, :2]
        r = np.max(r)
        p = p[np.all(np.isfinite(p), axis=1)]
        if len(p):
            low = np.minimum(low, p.min(0) - r)
            high = np.maximum(high, p.max(0) + r)

    for f in frames:
        if kind == "curves":
            half = rod_length(case) / 2
            for column in f.path.T:
                take(np.stack((f.times, column - half), 1))
                take(np.stack((f.times, column + half), 1))
            take([[case.t[0], f.x[0]], [case.t[-1], f.x[0]]])
            continue
        if kind == "plane":
            take(f.path)
        elif np.all(np.isfinite(f.x)):
            for key, r in particle_groups(case).items():
                p = particle_centres(f.x, key)
                if len(p) > MAX_DISCS:
                    p = _inside(p)
                    r = 0.0
                take(p, 0.0 if r is None else r)
        for c in getattr(case.problem, "constraints", ()):
            if isinstance(c, Distance) and c.anchors is not None and c.dim > 1:
                r = c.d if c.pairs is None or kind == "plane" else 0.0
                take(anchor_points(c, f.t), r)
    return low, high


def rod_length(case: Case) -> float:
    """Return the length of the rods of a case on a line, else 0."""
    return next(
        (
            float(c.d)
            for c in getattr(case.problem, "constraints", ())
            if isinstance(c, Distance) and c.dim == 1 and c.all_pairs and c.d is not None
        ),
        0.0,
    )


def _window(p):
    """Indices, in order, of the MAX_DISCS points nearest to the middle."""
    mid = np.median(p, axis=0)
    return np.sort(np.argpartition(np.sum((p - mid) ** 2, axis=1), MAX_DISCS)[:MAX_DISCS])


def _inside(p):
    """Two opposite corners of a square that the window fills."""
    q = p[_window(p), :2]
    mid = np.median(p[:, :2], axis=0)
    half = np.max(np.linalg.norm(q - mid, axis=1)) / 2**0.5
    return np.stack((mid - half, mid + half))


def shade_forbidden(ax, gap: Callable[[np.ndarray], np.ndarray]) -> None:
    """Shade where gap(points (m, 2)) < 0 inside the present limits, with its edge."""
    (x0, x1), (y0, y1) = ax.get_xlim(), ax.get_ylim()
    X, Y = np.meshgrid(np.linspace(x0, x1, CONTOUR_POINTS), np.linspace(y0, y1, CONTOUR_POINTS))
    g = gap(np.stack((X.ravel(), Y.ravel()), 1)).reshape(X.shape)
    if np.nanmin(g) < 0:
        ax.contourf(X, Y, g, levels=[-1e300, 0.0], colors=[FORBIDDEN], zorder=0)
        if np.nanmax(g) > 0:
            ax.contour(X, Y, g, levels=[0.0], colors=[GREY], linewidths=0.9, zorder=1)


def find_walls(case, key, radius, t):
    """Half-planes a . p + b >= 0 (m, 3) that bound the surfaces of the particles of one group.

    These are the distinct Affine rows that move one particle; none if there are more than
    MAX_WALLS.
    """
    start, dim, count = key
    rows = []
    for c in case.problem.constraints:
        if not isinstance(c, Affine):
            continue
        b = np.asarray(as_numpy(c.b)(t) if callable(c.b) else c.b, dtype=float)
        owner = (c.indices - start) // dim
        first = c.indptr[:-1]
        lowest = np.minimum.reduceat(owner, first)
        highest = np.maximum.reduceat(owner, first)
        alone = (lowest == highest) & (lowest >= 0) & (highest < count)
        a = np.zeros((len(b), dim))
        row = np.repeat(np.arange(len(b)), np.diff(c.indptr))
        inside = alone[row]
        np.add.at(a, (row[inside], (c.indices[inside] - start) % dim), c.data[inside])
        a = a[alone, :2]
        b = b[alone]
        owner = owner[first][alone]
        size = np.linalg.norm(a, axis=1)
        keep = size > 0
        r = np.broadcast_to(0.0 if radius is None else radius, count)[owner[keep]]
        rows.append(np.column_stack((a[keep] / size[keep, None], b[keep] / size[keep] + r)))
    rows = np.unique(np.round(np.concatenate(rows), 9), axis=0) if rows else np.empty((0, 3))
    return rows if len(rows) <= MAX_WALLS else rows[:0]


def draw_particles(ax, case: Case, frame, scale: float) -> None:
    """Draw discs, links, anchors and walls of one state; `scale` points per unit of length."""
    for key, radius in particle_groups(case).items():
        walls = find_walls(case, key, radius, frame.t)
        if len(walls):
            shade_forbidden(ax, lambda p, w=walls: (p @ w[:, :2].T + w[:, 2]).min(1))
        if key[1] > 1:
            _links(ax, case, key, frame, radius)
            _discs(ax, particle_centres(frame.x, key), radius, scale)


def _discs(ax, p, radius, scale):
    """Draw discs at p (count, dim), in space from low to high, and lines between contacts."""
    from scipy.spatial import cKDTree

    total = len(p)
    which = _window(p) if total > MAX_DISCS else np.arange(total)
    order = which[np.argsort(p[which, 2], kind="stable")] if p.shape[1] == 3 else which
    if radius is None:
        ax.scatter(*p[order, :2].T, s=14, color=BLUE, linewidths=0, zorder=4)
        return
    r = np.broadcast_to(radius, total)
    size = (2 * scale * r[order]) ** 2  # area in points, for a diameter in data units
    ax.scatter(
        *p[order, :2].T,
        s=size if np.ptp(r) else size[:1],
        facecolors=SKY + "66",
        edgecolors=BLUE,
        linewidths=0.9 if total < 200 else 0.4,
        zorder=3,
    )
    if total > MAX_DISCS:
        ax.text(
            0.98,
            0.02,
            f"{MAX_DISCS} of {total} discs",
            transform=ax.transAxes,
            ha="right",
            fontsize=7,
            zorder=6,
            bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.5},
        )
    q = p[which]
    rq = r[which]
    pairs = cKDTree(q).query_pairs(2 * rq.max() * (1 + CONTACT_TOLERANCE), output_type="ndarray")
    pairs = pairs[np.lexsort(pairs.T[::-1])]
    gap = np.linalg.norm(q[pairs[:, 0]] - q[pairs[:, 1]], axis=1) - rq[pairs].sum(1)
    near = CONTACT_TOLERANCE * 2 * rq.max()
    for touching, colour, width in ((np.abs(gap) <= near, BLUE, 1.0), (gap < -near, RED, 1.8)):
        _segments(
            ax,
            q[pairs[touching, 0]],
            q[pairs[touching, 1]],
            colors=colour,
            linewidths=width,
            zorder=4,
        )


def _segments(ax, p, q, **look):
    """Draw segments from p (m, dim) to q (m, dim)."""
    from matplotlib.collections import LineCollection

    if len(p):
        ax.add_collection(LineCollection(np.stack((p[:, :2], q[:, :2]), 1), **look), autolim=False)


def _links(ax, case, key, frame, radius):
    """Draw links (taut: black, slack: grey and dashed), anchors as squares, obstacles filled."""
    x = particle_centres(frame.x, key)
    for c in case.problem.constraints:
        if (
            not isinstance(c, Distance)
            or c.all_pairs
            or (c.start, c.dim, c.particles(case.n)) != key
        ):
            continue
        other = x if c.anchors is None else anchor_points(c, frame.t)
        if c.anchors is not None and c.sign > 0:
            near = c.d - (0.0 if radius is None else np.min(radius))
            shade_forbidden(
                ax,
                lambda p, o=other, d=near: (np.linalg.norm(p[:, None] - o[:, :2], axis=2) - d).min(
                    1
                ),
            )
            continue
        pairs = c.pairs
        if pairs is None:
            pairs = np.stack(np.meshgrid(range(len(x)), range(len(other))), -1).reshape(-1, 2)
        p = x[pairs[:, 0]]
        q = other[pairs[:, 1]]
        if c.sign < 0:
            taut = np.linalg.norm(p - q, axis=1) >= c.d * (1 - CONTACT_TOLERANCE)
            _segments(
                ax, p[~taut], q[~taut], colors=GREY, linewidths=0.8, linestyles="--", zorder=2
            )
            _segments(ax, p[taut], q[taut], colors=BLACK, linewidths=1.5, zorder=2)
        if c.anchors is not None:
            ax.scatter(*other[:, :2].T, marker="s", s=22, color=BLACK, linewidths=0, zorder=5)
