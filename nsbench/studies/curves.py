"""Panels of curves on linear or logarithmic axes, as the figures of studies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from nsbench.report.scenes.figure import STYLE, write_svg
from nsbench.report.style import MUTED, PALETTE

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MARKERS = "os^Dvp*X<>"
PANEL_INCHES = (2.9, 2.3)
MAX_LABELS = 5  # of a logarithmic axis
MIN_DECADES = 2.0  # of an axis that is labelled by powers of ten alone
BELOW = -0.22  # heights of a panel from its bottom to the top of a legend below its label
LEGEND_LINE = 0.14  # inches of a line of a legend that stands below its panel
# curves of a legend that lies inside its panel, and characters of its names; a longer or wider one
# stands below, off the curves
MOST_INSIDE = 4
LONGEST_INSIDE = 12


@dataclass(frozen=True)
class Curve:
    """One curve: name, points x, y; guide: drawn thin and without markers."""

    name: str
    x: Sequence[float]
    y: Sequence[float]
    guide: bool = False


@dataclass(frozen=True)
class Panel:
    """One panel: title, curves, labels, kind of the axes; limits (low, high) of y or None."""

    title: str
    curves: tuple[Curve, ...]
    x_label: str
    y_label: str
    x_log: bool = True
    y_log: bool = True
    y_limits: tuple[float, float] | None = None
    has_legend: bool = True


def draw_panels(panels: Sequence[Panel], columns: int = 4) -> str:
    """Draw panels in rows of at most `columns`, as SVG text; empty or no points are left out."""
    return write_svg(make_figure(panels, columns))


def make_figure(panels: Sequence[Panel], columns: int = 4) -> Figure:
    """Return the figure of `draw_panels`."""
    import matplotlib
    from matplotlib.figure import Figure

    columns = min(columns, len(panels))
    rows = [panels[k : k + columns] for k in range(0, len(panels), columns)]
    width, height = PANEL_INCHES
    heights = [height + LEGEND_LINE * max(map(_lines_below, row)) for row in rows]
    with matplotlib.rc_context(STYLE):
        size = (width * columns, sum(heights))
        figure = Figure(figsize=size, facecolor="white", layout="constrained")
        # a row of its own for legends: in one grid all rows would be as far apart as one needs
        parts = figure.subfigures(len(rows), 1, squeeze=False, height_ratios=heights)
        for part, row in zip(parts[:, 0], rows, strict=True):
            places = part.subplots(1, columns, squeeze=False)[0]
            for axes, panel in zip(places, row, strict=False):
                _draw_panel(axes, panel)
            for axes in places[len(row) :]:
                axes.set_axis_off()
    return figure


def _lines_below(panel: Panel) -> int:
    return len(panel.curves) * _has_legend_below(panel)


def _has_legend_below(panel: Panel) -> bool:
    longest = max((len(c.name) for c in panel.curves), default=0)
    is_large = len(panel.curves) > MOST_INSIDE or longest > LONGEST_INSIDE
    return panel.has_legend and is_large


def _draw_panel(axes, panel: Panel) -> None:
    drawn = 0
    for curve in panel.curves:
        x = np.array([np.nan if v is None else v for v in curve.x], float)
        y = np.array([np.nan if v is None else v for v in curve.y], float)
        used = np.isfinite(x) & np.isfinite(y) & ~((y <= 0.0) & panel.y_log)
        if not used.any():
            continue
        if curve.guide:
            axes.plot(x[used], y[used], color=MUTED, lw=0.7, ls="--", label=curve.name)
            continue
        colour = PALETTE[drawn % len(PALETTE)]
        marker = MARKERS[drawn % len(MARKERS)]
        axes.plot(
            x[used], y[used], marker=marker, ms=3, lw=1.0, color=colour, label=curve.name
        )
        drawn += 1
    if panel.y_limits is not None:
        axes.set_ylim(*panel.y_limits)
    if panel.x_log:
        scale_log(axes.xaxis, axes.set_xscale)
    if panel.y_log:
        scale_log(axes.yaxis, axes.set_yscale)
    axes.set_title(panel.title, size=8.5, loc="left")
    axes.set_xlabel(panel.x_label)
    axes.set_ylabel(panel.y_label)
    if panel.has_legend and panel.curves:
        below = {"loc": "upper left", "bbox_to_anchor": (0.0, BELOW)}
        place = below if _has_legend_below(panel) else {}
        axes.legend(frameon=False, fontsize=6.5, **place)


def scale_log(axis, set_scale) -> None:
    """Make an axis logarithmic, with few labels in plain text: the style parses no mathematics."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    set_scale("log")
    low, high = axis.get_view_interval()
    few = np.log10(high / low) < MIN_DECADES
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if few else (1.0,), numticks=MAX_LABELS))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())
