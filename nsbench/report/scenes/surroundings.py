"""Surroundings of a path in the plane: forbidden regions, switching surfaces, directions."""

from __future__ import annotations

import numpy as np

from nsbench.case import Case
from nsbench.compilation.factories import as_numpy
from nsbench.problem import Filippov
from nsbench.report.scenes.plane import smallest_gap

POINTS = 81  # along each axis, for contours
ARROWS = 11  # along each axis
MAX_VERTICES = 160  # of one polygon or line


def draw_surroundings(case: Case, box: list[float]) -> dict:
    """Return region, lines and arrows of the plane inside `box`, at the start of a run.

    region: polygons where some constraint is violated. lines: where a switching function of a
    Filippov system vanishes. arrows: [x, y, direction x, direction y], of length 1, of its fields.
    """
    x = np.linspace(box[0], box[1], POINTS)
    y = np.linspace(box[2], box[3], POINTS)
    grid = np.stack(np.meshgrid(x, y), axis=-1)
    points = grid.reshape(-1, 2)
    t = float(case.t[0])
    out: dict = {"region": [], "lines": [], "arrows": []}
    if not isinstance(case.problem, Filippov):
        gap = smallest_gap(case, t, points).reshape(POINTS, POINTS)
        out["region"] = _filled(x, y, gap)
        return out
    switch = as_numpy(case.problem.switch)
    values = np.array([switch(t, p) for p in points]).reshape(POINTS, POINTS, -1)
    for k in range(values.shape[2]):
        out["lines"] += _contour(x, y, values[..., k])
    out["arrows"] = _arrows(case, t, box)
    return out


def _arrows(case: Case, t: float, box: list[float]) -> list[list[float]]:
    """Directions of the field on a coarse grid."""
    switch = as_numpy(case.problem.switch)
    field = as_numpy(case.problem.field)
    out = []
    for a in _centres(box[0], box[1]):
        for b in _centres(box[2], box[3]):
            p = np.array([a, b])
            v = np.asarray(field(t, p, np.sign(switch(t, p))), dtype=float)
            size = float(np.linalg.norm(v))
            if np.isfinite(size) and size > 0:
                out.append([float(f"{w:.3g}") for w in (a, b, *(v / size))])
    return out


def _centres(low: float, high: float) -> np.ndarray:
    return low + (high - low) * (np.arange(ARROWS) + 0.5) / ARROWS


def _filled(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> list[list]:
    """Polygons where z < 0; the holes of a region are polygons of their own (even-odd rule)."""
    from contourpy import contour_generator

    if not np.nanmin(z) < 0:
        return []
    filled = contour_generator(x, y, z).filled(-1e300, 0.0)
    points, offsets = filled
    return [
        _thin(polygon[a:b])
        for polygon, ends in zip(points, offsets, strict=True)
        for a, b in zip(ends[:-1], ends[1:], strict=True)
    ]


def _contour(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> list[list]:
    """Lines where z = 0."""
    from contourpy import contour_generator

    return [_thin(line) for line in contour_generator(x, y, z).lines(0.0)]


def _thin(points: np.ndarray) -> list[list[float]]:
    """A polygon or line with at most MAX_VERTICES points of three digits."""
    at = np.unique(np.linspace(0, len(points) - 1, min(len(points), MAX_VERTICES)).astype(int))
    return [[float(f"{a:.3g}"), float(f"{b:.3g}")] for a, b in points[at]]
