"""Figures of the study `lemma`: dual graphs with numbered contacts, constants, distribution."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nsbench.report.scenes.figure import STYLE, write_svg
from nsbench.report.style import INK, MUTED, PALETTE, RULE
from nsbench.studies.curves import scale_log
from nsbench.studies.lemma.random_packings import share_interval
from nsbench.studies.packings.contact_graphs import ContactGraph

BLUE, ORANGE, GREEN = PALETTE[:3]
PANEL_INCHES = 2.9
MAX_NUMBERED = 60  # contacts of a panel; more numbers could not be read


@dataclass(frozen=True)
class NumberedGraph:
    """One panel: a packing, an order of its contacts, the gaps before and the target contact."""

    title: str
    graph: ContactGraph
    order: np.ndarray
    gaps: np.ndarray
    target: int


def draw_dual_graphs(panels: list[NumberedGraph]) -> str:
    """Draw discs, the dual graph and the place of each contact in the order, as SVG text.

    Filled dots: contacts that are violated before the sweep; a ring: the contact that is left with
    the largest violation. Lines join contacts of one disc.
    """
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(PANEL_INCHES * len(panels), PANEL_INCHES), facecolor="white")
        for column, panel in enumerate(panels):
            axes = figure.add_subplot(1, len(panels), column + 1)
            _draw_graph(axes, panel)
        figure.subplots_adjust(0.01, 0.01, 0.99, 0.92, 0.04, 0.0)
    return write_svg(figure)


def _draw_graph(axes, panel: NumberedGraph) -> None:
    from matplotlib.collections import LineCollection
    from matplotlib.patches import Circle

    graph = panel.graph
    for centre, radius in zip(graph.centres, graph.radii, strict=True):
        axes.add_patch(Circle(centre, radius, facecolor="#f4f9fd", edgecolor=RULE, linewidth=0.8))
    i, j = graph.pairs.T
    # contacts lie where the discs touch
    share = (graph.radii[i] / (graph.radii[i] + graph.radii[j]))[:, None]
    points = graph.centres[i] + share * (graph.centres[j] - graph.centres[i])
    gram = graph.gram
    first, second = np.nonzero(np.triu(gram, 1))
    lines = np.stack((points[first], points[second]), axis=1)
    colours = [ORANGE if gram[a, b] < 0.0 else MUTED for a, b in zip(first, second, strict=True)]
    axes.add_collection(LineCollection(lines, colors=colours, linewidths=0.6, alpha=0.7, zorder=2))
    violated = panel.gaps < 0.0
    axes.scatter(
        *points.T,
        s=90,
        facecolors=np.where(violated, BLUE, "#ffffff"),
        edgecolors=BLUE,
        linewidths=0.9,
        zorder=3,
    )
    axes.scatter(
        *points[panel.target], s=190, facecolors="none", edgecolors=INK, linewidths=1.4, zorder=4
    )
    if len(points) <= MAX_NUMBERED:
        place = np.argsort(panel.order)
        for k, point in enumerate(points):
            axes.text(
                *point,
                str(place[k] + 1),
                size=5.5,
                color="#ffffff" if violated[k] else INK,
                ha="center",
                va="center",
                zorder=5,
            )
    axes.set_title(panel.title, size=8.5, loc="left")
    axes.set_aspect("equal")
    axes.autoscale_view()
    axes.set_axis_off()


def draw_constants(entries: list[dict]) -> str:
    """Draw exact value, search and bound over the number of contacts; chains left, hex right."""
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(2 * PANEL_INCHES, 0.8 * PANEL_INCHES), facecolor="white")
        for column, (family, title) in enumerate(
            (("chain", "chains"), ("hex", "hexagonal patches"))
        ):
            axes = figure.add_subplot(1, 2, column + 1)
            chosen = [e for e in entries if e["name"].startswith(family)]
            n = [e["n"] for e in chosen]
            axes.plot(n, [e["bound"] for e in chosen], "^-", color=ORANGE, ms=4, label="bound")
            axes.plot(n, [e["search"] for e in chosen], "o-", color=BLUE, ms=4, label="search")
            exact = [np.nan if e["exact"] is None else e["exact"] for e in chosen]
            axes.plot(n, exact, "x", color=INK, ms=6, label="exact")
            axes.set_xlabel("discs")
            axes.set_ylabel("C" if column == 0 else "")
            axes.set_ylim(bottom=0.0)
            axes.set_title(title, size=8.5, loc="left")
            axes.legend(frameon=False, fontsize=7)
        figure.subplots_adjust(0.08, 0.18, 0.98, 0.9, 0.18, 0.0)
    return write_svg(figure)


def draw_distribution(values: np.ndarray, band: float, tail: np.ndarray) -> str:
    """Draw the share of random packings with a constant above c: all of it, and its tail.

    band: half width of the uniform confidence band. tail: rows (c, P(C > c), low, high).
    """
    import matplotlib
    from matplotlib.figure import Figure

    values = np.sort(values)
    share = 1.0 - np.arange(1, len(values) + 1) / len(values)
    # at most this many points: a finer curve does not show
    keep = np.unique(np.linspace(0, len(values) - 1, 400).astype(int))
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(2 * PANEL_INCHES, 0.8 * PANEL_INCHES), facecolor="white")
        axes = figure.add_subplot(1, 2, 1)
        low = np.maximum(share - band, 0.0)[keep]
        high = np.minimum(share + band, 1.0)[keep]
        axes.fill_between(values[keep], low, high, color=BLUE, alpha=0.2, linewidth=0.0)
        axes.plot(values[keep], share[keep], color=BLUE, linewidth=1.2)
        axes.set_xlabel("c")
        axes.set_ylabel("share of packings with C > c")
        axes.set_ylim(0.0, 1.0)
        _draw_tail(figure.add_subplot(1, 2, 2), values, tail)
        figure.subplots_adjust(0.09, 0.18, 0.98, 0.96, 0.26)
    return write_svg(figure)


def _draw_tail(axes, values: np.ndarray, tail: np.ndarray) -> None:
    """Draw the tail of sorted values, and its estimates by splitting, on a logarithmic axis."""
    count = len(values)
    c, mean, low, high = tail[tail[:, 1] > 0.0].T
    # ranks from the largest value on, evenly on the logarithmic axis
    above = np.unique(np.geomspace(1, count - 1, 200).astype(int)) if count > 1 else [0]
    shares = [share_interval(int(k), count) for k in above]
    place = values[count - 1 - np.array(above)]
    axes.fill_between(place, *np.transpose(shares), color=BLUE, alpha=0.2, linewidth=0.0)
    axes.plot(place, np.array(above) / count, color=BLUE, linewidth=1.2, label="plain samples")
    errors = mean - low, high - mean
    axes.errorbar(
        c, mean, errors, fmt="o", ms=3, color=ORANGE, elinewidth=0.9, label="splitting"
    )
    axes.set_xlabel("c")
    # intervals that end at 0 leave the panel below
    axes.set_ylim(0.2 * min([1.0 / count, *mean]), 1.0)
    scale_log(axes.yaxis, axes.set_yscale)
    axes.legend(frameon=False, fontsize=7)
