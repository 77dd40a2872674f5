"""Figures of the study `fan`: exact flows from the steps of a run, and the parts of its error."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nsbench.report.scenes.figure import STYLE, write_svg
from nsbench.report.style import INK, MUTED, PALETTE

BLUE, ORANGE, GREEN = PALETTE[:3]
SMALLEST_SHARE = 0.01  # shares that are all below it are drawn as none
PHASE_COLOURS = {"free": BLUE, "event": ORANGE, "contact": GREEN}
VIOLATION = "violation left"


@dataclass(frozen=True)
class FanCurves:
    """States x (N + 1,) of a method at t (N + 1,); exact solutions (times, values) from them."""

    t: np.ndarray
    x: np.ndarray
    curves: list[tuple[np.ndarray, np.ndarray]]


def draw_fans(fan: FanCurves) -> str:
    """Draw a method and the exact solutions from each of its states, as SVG text."""
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(4.6, 2.5), facecolor="white")
        axes = figure.add_subplot(1, 1, 1)
        for k, (times, values) in enumerate(fan.curves):
            first = k == 0
            colour = INK if first else BLUE
            axes.plot(times, values, color=colour, lw=1.4 if first else 0.8, zorder=3 - (not first))
        axes.plot(fan.t, fan.x, "o", color=ORANGE, ms=3.5)
        axes.set_xlabel("t")
        axes.set_ylabel("y")
        figure.subplots_adjust(0.1, 0.17, 0.98, 0.97)
    return write_svg(figure)


def draw_parts(entries: list[dict]) -> str:
    """Draw the share of every step in the global error, one panel for each fan, as SVG text.

    The violation that the last sweep left is a bar of its own after the end.
    """
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(2.2 * len(entries), 2.2), facecolor="white")
        for column, e in enumerate(entries):
            _draw_shares(figure.add_subplot(1, len(entries), column + 1), e)
        for name, colour in {**PHASE_COLOURS, VIOLATION: MUTED}.items():
            figure.axes[-1].plot([], [], "s", color=colour, label=name)
        figure.axes[-1].legend(frameon=False, fontsize=6.5)
        figure.subplots_adjust(0.06, 0.18, 0.99, 0.9, 0.3, 0.0)
    return write_svg(figure)


def _draw_shares(axes, e: dict) -> None:
    """Draw the bars of one fan."""
    starts = np.array(e["times"])
    width = starts[-1] - starts[-2]
    shares = np.append(e["parts"], e["violation_share"] or 0.0)
    colours = [*(PHASE_COLOURS[p] for p in e["phases"]), MUTED]
    axes.bar(starts, shares, np.append(np.diff(starts), width), align="edge", color=colours)
    if np.abs(shares).max() < SMALLEST_SHARE:
        axes.set_ylim(-SMALLEST_SHARE, SMALLEST_SHARE)
    axes.axhline(0.0, color=INK, lw=0.6)
    axes.axvline(starts[-1], color=INK, lw=0.6, ls=":")
    axes.set_title(f"{e['case'].partition('[')[0]} to t = {e['end']:g}", size=8, loc="left")
    axes.set_xlabel("t")
