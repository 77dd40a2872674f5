"""Marks of a chart of errors that lie on each other: hovering finds the one on top, and names all.

Two marks coincide if they are of one kind and less than a pixel apart in a chart of WIDTH x HEIGHT
pixels that shows all its rows. kinds and rows: see nsbench.report.charts.layouts.error_chart.
"""

from __future__ import annotations

import numpy as np

from nsbench.report.charts.files import WIDTH
from nsbench.report.charts.layouts import HEIGHT

# which coordinates place a mark of a kind: others stand at an edge, or reach across
PLACED_BY = {"error": "xy", "zero": "x", "failed": "x", "level": "y"}
REACH = 10.0  # the error of a reference is shown as a band if no error is further above it
CLOSE = 1.0  # pixels


def coincident_methods(points: list[dict]) -> list[list]:
    """List, for each row of a chart of errors, the methods whose marks lie where its own does.

    The method of the row is one of them; they come in the order of the rows.
    """
    found: list[list] = [[p["method"]] for p in points]
    kinds = {kind: [i for i, p in enumerate(points) if p["kind"] == kind] for kind in PLACED_BY}
    spans = {c: _pixels_per_decade(points, c) for c in "xy"}
    for kind, rows in kinds.items():
        near = np.ones((len(rows), len(rows)), bool)
        for c in PLACED_BY[kind]:
            at = spans[c] * np.log10([points[i][c] for i in rows])
            near &= np.abs(at[:, None] - at) < CLOSE
        for i, others in zip(rows, near, strict=True):
            names = (points[rows[j]]["method"] for j in np.flatnonzero(others))
            found[i] = list(dict.fromkeys(names))
    return found


def _pixels_per_decade(points: list[dict], coordinate: str) -> float:
    """Pixels of a decade where the chart shows all rows; 1 where they have one value."""
    shown = [p[coordinate] for p in points if coordinate in PLACED_BY[p["kind"]]]
    extent = float(np.ptp(np.log10(shown))) if shown else 0.0
    return {"x": WIDTH, "y": HEIGHT}[coordinate] / extent if extent else 1.0


def name_together(points: list[dict]) -> None:
    """Add to rows with a method the field `methods`: the names of all that coincide with it."""
    marks = [p for p in points if "method" in p]
    for point, methods in zip(marks, coincident_methods(marks), strict=True):
        point["methods"] = ", ".join(methods)
