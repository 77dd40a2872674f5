"""Figures of the study `chain`: projections one after the other, corrections over the distance."""

from __future__ import annotations

import numpy as np

from nsbench.report.scenes.figure import STYLE, write_svg
from nsbench.report.style import INK, MUTED, PALETTE
from nsbench.studies.chain.large_steps import Frame
from nsbench.studies.curves import Curve, Panel, draw_panels

BLUE, ORANGE = PALETTE[:2]
FRAME_INCHES = 1.35
MARGIN = 0.15  # around the discs, in radii
LOWEST = 1e-6  # corrections below it are not drawn


def draw_projections(rows: list[tuple[str, list[Frame]]], radius: float) -> str:
    """Draw steps as rows of frames: discs, their last displacement, overlaps in another colour."""
    import matplotlib
    from matplotlib.figure import Figure

    columns = max(len(frames) for _, frames in rows)
    points = np.concatenate([f.x for _, frames in rows for f in frames])
    low = points.min(axis=0) - radius * (1.0 + MARGIN)
    high = points.max(axis=0) + radius * (1.0 + MARGIN)
    size = (FRAME_INCHES * columns, (FRAME_INCHES + 0.3) * len(rows))
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=size, facecolor="white")
        for row, (title, frames) in enumerate(rows):
            for column, frame in enumerate(frames):
                axes = figure.add_subplot(len(rows), columns, row * columns + column + 1)
                before = frames[column - 1] if column else None
                _draw_frame(axes, frame, before, radius)
                axes.set_xlim(low[0], high[0])
                axes.set_ylim(low[1], high[1])
                label = f"{title}\n{frame.label}" if column == 0 else f"\n{frame.label}"
                axes.set_title(label, size=7.0, loc="left")
        figure.subplots_adjust(0.005, 0.005, 0.995, 0.88, 0.04, 0.18)
    return write_svg(figure)


def _draw_frame(axes, frame: Frame, before: Frame | None, radius: float) -> None:
    from matplotlib.patches import Circle

    for k, centre in enumerate(frame.x):
        moved = frame.pair is not None and k in frame.pair
        axes.add_patch(
            Circle(
                centre,
                radius,
                facecolor=BLUE if moved else MUTED,
                alpha=0.18,
                edgecolor="none",
            )
        )
        axes.add_patch(Circle(centre, radius, fill=False, edgecolor=BLUE, linewidth=0.8))
        axes.text(*centre, str(k + 1), size=6.5, ha="center", va="center", color=INK)
        if before is not None and np.linalg.norm(centre - before.x[k]) > 1e-9:
            axes.annotate(
                "",
                centre,
                before.x[k],
                arrowprops={"arrowstyle": "->", "color": INK, "linewidth": 0.8},
            )
    for i in range(len(frame.x)):
        for j in range(i + 1, len(frame.x)):
            if np.linalg.norm(frame.x[i] - frame.x[j]) < 2.0 * radius * (1.0 - 1e-9):
                axes.plot(*frame.x[[i, j]].T, color=ORANGE, linewidth=2.2, alpha=0.8)
    axes.set_aspect("equal")
    axes.set_axis_off()


def draw_decay(panels: list[tuple[str, dict[str, np.ndarray]]]) -> str:
    """Draw the largest correction over the distance from the violated contact, by order."""
    return draw_panels(
        [
            Panel(
                title,
                tuple(
                    Curve(name, range(len(values)), np.where(values > LOWEST, values, np.nan))
                    for name, values in curves.items()
                ),
                "distance in the dual graph",
                "largest correction",
                x_log=False,
                y_limits=(LOWEST, 2.0),
                has_legend=column == 0,
            )
            for column, (title, curves) in enumerate(panels)
        ]
    )
