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
LEGEND_INCHES = 1.7  # of a legend that stands beside its panel
MAX_LABELS = 5  # of a logarithmic axis
MIN_DECADES = 2.0  # of an axis that is labelled by powers of ten alone
BELOW = -0.22  # heights of a panel from its bottom to the top of a legend below its label
LEGEND_LINE = 0.14  # inches of a line of a legend that stands below its panel
MOST_INSIDE = 4  # curves of a legend that lies inside its panel; a longer one stands beside it
LONGEST_INSIDE = 12  # characters of its names; with longer ones it stands below, off the curves


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
    rows = -(-len(panels) // columns)
    width, height = PANEL_INCHES
    width += LEGEND_INCHES * any(map(_has_long_legend, panels))
    height += LEGEND_LINE * max(len(p.curves) * _has_wide_legend(p) for p in panels)
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(width * columns, height * rows), facecolor="white")
        for k, panel in enumerate(panels):
            _draw_panel(figure.add_subplot(rows, columns, k + 1), panel)
        figure.tight_layout(pad=0.4)
    return figure


def _has_long_legend(panel: Panel) -> bool:
    return panel.has_legend and len(panel.curves) > MOST_INSIDE


def _has_wide_legend(panel: Panel) -> bool:
    longest = max((len(c.name) for c in panel.curves), default=0)
    return panel.has_legend and longest > LONGEST_INSIDE and not _has_long_legend(panel)


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
        place = {}
        if _has_long_legend(panel):
            place = {"loc": "upper left", "bbox_to_anchor": (1.0, 1.0)}
        elif _has_wide_legend(panel):
            place = {"loc": "upper left", "bbox_to_anchor": (0.0, BELOW)}
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
