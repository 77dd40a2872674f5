"""Draw paths: a point in the plane with constraints or switching surfaces, curves over time."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from nsbench.case import Case
from nsbench.compilation.factories import as_numpy
from nsbench.problem import Affine, Distance, Filippov, Smooth
from nsbench.report.scenes.particles import (
    BLACK,
    BLUE,
    CONTOUR_POINTS,
    FORBIDDEN,
    GREY,
    SKY,
    anchor_points,
    rod_length,
    shade_forbidden,
)

COLOURS = (BLUE, "#E69F00", "#009E73", "#CC79A7", SKY, "#D55E00")  # Okabe & Ito (2008)


def draw_plane(ax, case: Case, frame, scale: float) -> None:
    """Draw a point in the plane with its path.

    Behind it: the forbidden region, or the sides of the switching surfaces with their fields.
    """
    if isinstance(case.problem, Filippov):
        _sides(ax, case.problem, frame.t)
    else:
        shade_forbidden(ax, lambda p: smallest_gap(case, frame.t, p))
    ax.plot(*frame.path.T, "-", color=BLUE, lw=1.5, zorder=4)
    if len(frame.path) > 1:
        ax.plot(*frame.path[0], "o", ms=4, mfc="white", mec=BLUE, zorder=5)
    r = case.radius
    if r:
        ax.scatter(
            *frame.path[-1],
            s=(2 * r * scale) ** 2,
            facecolors=SKY + "66",
            edgecolors=BLUE,
            zorder=3,
        )
    ax.plot(*frame.path[-1], "o", ms=4, color=BLUE, zorder=5)
    _axes(ax, "x₁", "x₂")


def _axes(ax, along, up):
    """Few ticks, and names of the axes where tick labels cannot push them out of the picture."""
    ax.locator_params(nbins=4)
    ax.ticklabel_format(useOffset=False)
    ax.set_xlabel(along, labelpad=1.0)
    ax.annotate(
        up,
        (0.0, 1.0),
        xycoords="axes fraction",
        xytext=(-4, 3),
        textcoords="offset points",
        ha="right",
    )


def smallest_gap(case, t, points):
    """Smallest g(t, x) over all constraints at states (m, n), (m,); Smooth ones point by point."""
    g = np.full(len(points), np.inf)
    for c in case.problem.constraints:
        if isinstance(c, Affine):
            b = np.asarray(as_numpy(c.b)(t) if callable(c.b) else c.b, dtype=float)
            dense = np.zeros(c.shape)
            dense[np.repeat(np.arange(c.shape[0]), np.diff(c.indptr)), c.indices] = c.data
            g = np.minimum(g, (points @ dense.T + b).min(1))
        elif isinstance(c, Distance) and c.anchors is not None:
            distance = np.linalg.norm(
                points[:, None, c.start : c.start + c.dim] - anchor_points(c, t), axis=2
            )
            if c.pairs is not None:
                distance = distance[:, c.pairs[:, 1]]
            g = np.minimum(g, (c.sign * (distance - c.d)).min(1))
        elif isinstance(c, Smooth):
            f = as_numpy(c.g)
            g = np.minimum(g, [np.min(f(t, p)) for p in points])
    return g


def _sides(ax, problem, t):
    """Draw the switching surfaces, one side of the first tinted, and the field as unit arrows."""
    (x0, x1), (y0, y1) = ax.get_xlim(), ax.get_ylim()
    X, Y = np.meshgrid(np.linspace(x0, x1, CONTOUR_POINTS), np.linspace(y0, y1, CONTOUR_POINTS))
    switch = as_numpy(problem.switch)
    field = as_numpy(problem.field)
    c = np.array([switch(t, p) for p in np.stack((X.ravel(), Y.ravel()), 1)]).reshape(*X.shape, -1)
    ax.contourf(
        X, Y, c[..., 0], levels=[-1e300, 0.0, 1e300], colors=["#fdf3df", "#e8f2f9"], zorder=0
    )
    for k in range(c.shape[2]):
        if c[..., k].min() < 0 < c[..., k].max():
            ax.contour(X, Y, c[..., k], levels=[0.0], colors=[BLACK], linewidths=1.1, zorder=2)
    U, V = (m[5:-5:10, 5:-5:10] for m in (X, Y))
    arrows = np.array(
        [field(t, p, np.sign(switch(t, p))) for p in np.stack((U.ravel(), V.ravel()), 1)]
    )
    size = np.linalg.norm(arrows, axis=1, keepdims=True)
    arrows = arrows / np.where(size > 0, size, 1.0)
    ax.quiver(
        U.ravel(),
        V.ravel(),
        *arrows.T,
        color=GREY,
        pivot="mid",
        units="width",
        width=0.005,
        scale=22,
        headwidth=4,
        headlength=4,
        headaxislength=3.6,
        zorder=1,
    )


def draw_curves(ax, case: Case, frame, scale: float) -> None:
    """Draw the components over time; rods as bands of their length.

    The forbidden region is shaded where there is a single component.
    """
    y = frame.path
    half = rod_length(case) / 2
    if case.n == 1:
        _forbidden_times(ax, case)
    for k in range(case.n):
        colour = COLOURS[k % len(COLOURS)] if case.n <= len(COLOURS) else BLUE
        if half:
            ax.fill_between(
                frame.times,
                y[:, k] - half,
                y[:, k] + half,
                color=colour,
                alpha=0.25,
                lw=0,
                zorder=3,
            )
        ax.plot(
            frame.times,
            y[:, k],
            "-",
            color=colour,
            lw=1.4 if case.n <= len(COLOURS) else 0.7,
            zorder=4,
            clip_on=False,
        )
        ax.plot(frame.times[0], y[0, k], "o", ms=3, color=colour, zorder=5, clip_on=False)
    if 1 < case.n <= len(COLOURS):
        _name_ends(ax, frame, case.n)
    _axes(ax, "t", "x")


def _name_ends(ax, frame, n):
    """Write x1, x2, ... at the right ends of the curves, moved apart where they would overlap."""
    good = frame.path[np.all(np.isfinite(frame.path), axis=1)]
    if len(good) < 2:
        return
    low, high = ax.get_ylim()
    place = (good[-1] - low) / (high - low)
    order = np.argsort(place, kind="stable")
    for a, b in pairwise(order):
        place[b] = max(place[b], place[a] + 0.075)
    for k in range(n):
        ax.annotate(
            "x" + "₁₂₃₄₅₆"[k],
            (1.0, place[k]),
            xycoords="axes fraction",
            xytext=(2, -2),
            textcoords="offset points",
            color=COLOURS[k],
            annotation_clip=False,
        )


def _forbidden_times(ax, case):
    """Shade the forbidden region of a single coordinate over time, or draw its switch."""
    (t0, t1), (low, high) = ax.get_xlim(), ax.get_ylim()
    t = np.linspace(t0, t1, 2 * CONTOUR_POINTS)
    y = np.linspace(low, high, CONTOUR_POINTS)
    if isinstance(case.problem, Filippov):
        switch = as_numpy(case.problem.switch)
        g = np.array([[switch(s, np.array([v]))[0] for s in t] for v in y])
        if g.min() < 0 < g.max():
            ax.contour(t, y, g, levels=[0.0], colors=[BLACK], linewidths=1.0, zorder=1)
        return
    if not getattr(case.problem, "constraints", ()):
        return
    g = np.stack([smallest_gap(case, s, y[:, None]) for s in t], 1)
    if g.min() < 0 < g.max():
        ax.contourf(t, y, g, levels=[-1e300, 0.0], colors=[FORBIDDEN], zorder=0)
        ax.contour(t, y, g, levels=[0.0], colors=[GREY], linewidths=0.9, zorder=1)
