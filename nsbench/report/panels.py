"""One log-log panel as SVG, drawn with matplotlib's Figure (no pyplot), the same bytes for the same data.

Logarithms are taken here and the axes are linear: matplotlib's own log axes cost five times as much, and errors of
exactly 0 need a place of their own, the bottom edge.
"""
from __future__ import annotations

import io
import math
import re
from dataclasses import dataclass

import numpy as np

from nsbench.report.style import INK, MUTED, PALETTE, PAPER, RULE, SHADE, Look, html, num

SIZE = (3.5, 2.75)          # inches; 252 x 198 units of the viewBox
FAR = 2.0                   # decades below the points from which a level is no longer drawn to scale
POINTS = 48                 # markers per line: more of them are thinned, their line is not the worse for it
_TONES = {**{c: f"var(--m{i})" for i, c in enumerate(PALETTE)}, INK: "currentColor", MUTED: "var(--muted)",
          RULE: "var(--rule)", SHADE: "var(--shade)", PAPER: "var(--paper)"}


@dataclass(frozen=True)
class Line:
    """Points of one method. x, y (k,): positive or 0 (a y of 0 is drawn open at the bottom edge).

    failed: the x of runs that gave no number, crossed at the top edge. level: y of a method without an x of this
    kind, drawn across. hollow: open markers (the loop is not compiled).
    far: errors of another league (a tolerance, or rounding); they may stay at the bottom edge with their value, so as
    not to press the other lines flat.
    """
    name: str
    look: Look
    x: np.ndarray
    y: np.ndarray
    failed: np.ndarray
    level: float = math.nan
    hollow: bool = False
    far: bool = False


@dataclass(frozen=True)
class Panel:
    """What one picture shows. floor: shaded below; slopes: guides of these orders; key: part of its file name."""
    key: str
    title: str
    xlabel: str
    lines: tuple[Line, ...]
    floor: float = 0.0
    slopes: tuple[float, ...] = ()
    note: str = ""


def draw(panel: Panel, salt: str) -> str:
    """The panel as an SVG element in the colours of the light page; see `inline` and `sheet`."""
    from matplotlib.figure import Figure
    fig = Figure(figsize=SIZE)
    ax = fig.add_axes((0.135, 0.165, 0.845, 0.73), facecolor="none")
    fig.patch.set_visible(False)
    xs, ys = _limits(panel)
    if panel.floor > 0 and math.log10(panel.floor) > ys[0]:
        ax.axhspan(ys[0], math.log10(panel.floor), color=SHADE, lw=0)
        ax.text(xs[1], math.log10(panel.floor), "reference floor ", size=6.5, color=MUTED, ha="right", va="top")
    for p in panel.slopes:
        _guide(ax, p, panel, xs, ys)
    for line in panel.lines:
        _plot(ax, line, xs, ys)
    _axes(ax, panel, xs, ys)
    return _svg(fig, salt)


def _limits(panel: Panel):
    """Limits in decades, (x0, x1) and (y0, y1), a little beyond the data; zeros and failures get their edges.

    What lies far below the other lines, a level, a floor or errors of another league, stays at the bottom edge.
    """
    x = np.concatenate([np.concatenate([line.x, line.failed]) for line in panel.lines] or [np.ones(1)])
    near = [line.y for line in panel.lines if not line.far and np.any(line.y > 0)]
    rest = [line.y for line in panel.lines if line.far] if near else []
    points = np.concatenate(near or [line.y for line in panel.lines])
    levels = np.concatenate([[line.level for line in panel.lines], *rest])
    x, points, levels = (np.log10(v[np.isfinite(v) & (v > 0)]) for v in (x, points, levels))
    x = x if x.size else np.zeros(1)
    y = points if points.size else levels if levels.size else np.zeros(1)
    low, high = float(y.min()), float(y.max())
    for level in (*levels, math.log10(panel.floor) - 0.3 if panel.floor > 0 else low):
        low = min(low, level) if level > low - FAR else low
    high = max(high, *levels) if levels.size else high
    low = max(low, high - 18.0)
    if high - low < 1.2:
        low, high = (low + high) / 2 - 0.6, (low + high) / 2 + 0.6
    zero = any(np.any(line.y == 0) for line in panel.lines)
    below = zero or (levels.size and levels.min() < low)
    pad, room = 0.05 * max(float(np.ptp(x)), 1.0), 0.06 * (high - low)
    return (float(x.min()) - pad, float(x.max()) + pad), (low - room * (2.5 if below else 1), high + room * 1.5)


def _plot(ax, line: Line, xs, ys):
    gid = f"s{line.look.index}"
    style = {"color": line.look.colour, "lw": 1.2, "gid": gid, "clip_on": False}
    face = PAPER if line.hollow else line.look.colour
    dots = {"marker": line.look.marker, "ms": 3.6, "mew": 0.9}
    at = np.unique(np.linspace(0, len(line.x) - 1, min(len(line.x), POINTS)).astype(int))
    x, y = line.x[at], line.y[at]
    solid = (y > 0) & (x > 0)
    if solid.any():
        y10 = np.clip(np.log10(y[solid]), *ys)
        ax.plot(np.log10(x[solid]), y10, ls=line.look.line, mfc=face, **dots, **style)
        if line.far and np.log10(y[solid]).min() < ys[0]:
            k = int(np.argmin(y[solid]))
            ax.text(np.log10(x[solid][k]), ys[0] + 0.045 * (ys[1] - ys[0]), num(float(y[solid][k])), size=6.5,
                    color=line.look.colour, ha="center")
    if np.any(y == 0):
        ax.plot(np.log10(x[y == 0]), np.full(np.sum(y == 0), ys[0]), ls="none", mfc=PAPER, **dots, **style)
    if line.failed.size:
        ax.plot(np.log10(line.failed[:POINTS]), np.full(line.failed[:POINTS].size, ys[1]), ls="none", marker="x",
                ms=4.5, mew=1.1, **style)
    if line.level >= 0:
        level = math.log10(line.level) if line.level else -math.inf
        ax.plot(xs, np.full(2, max(level, ys[0])), ls=(0, (1, 2)), **style)
        if level < ys[0]:
            at = xs[0] + 0.015 * (xs[1] - xs[0]), ys[0] + 0.02 * (ys[1] - ys[0])
            ax.text(*at, num(line.level), size=6.5, color=line.look.colour)


def _guide(ax, p: float, panel: Panel, xs, ys):
    """A triangle of slope p in a lower corner: one decade across, or less where the panel has less."""
    k = panel.slopes.index(p)
    width = min(1.0, 0.18 * (xs[1] - xs[0]))
    height = min(p * width, 0.35 * (ys[1] - ys[0]))
    width = height / p
    right = xs[1] - 0.03 * (xs[1] - xs[0]) - k * 0.24 * (xs[1] - xs[0])
    bottom = ys[0] + 0.08 * (ys[1] - ys[0])
    if panel.floor > 0:
        bottom = max(bottom, math.log10(panel.floor) + 0.03 * (ys[1] - ys[0]))
    x, y = (right - width, right, right, right - width), (bottom, bottom, bottom + height, bottom)
    ax.plot(x, y, color=MUTED, lw=0.7)
    ax.text(right - width / 2, bottom - 0.012 * (ys[1] - ys[0]), f"order {p:g}", size=6.5, color=MUTED,
            ha="center", va="top")


def _axes(ax, panel: Panel, xs, ys):
    """Ticks, grid and labels by hand: matplotlib's axis objects would take half of the time of the whole page."""
    from matplotlib.collections import LineCollection
    wide, high = xs[1] - xs[0], ys[1] - ys[0]
    ax.set(xlim=xs, ylim=ys)
    ax.set_axis_off()
    x, y = _ticks(*xs), _ticks(*ys)
    grid = [[(k, ys[0]), (k, ys[1])] for k in x] + [[(xs[0], k), (xs[1], k)] for k in y]
    frame = [[(xs[0], ys[1]), (xs[0], ys[0])], [(xs[0], ys[0]), (xs[1], ys[0])]]
    ax.add_collection(LineCollection(grid, colors=RULE, linewidths=0.5, zorder=0), autolim=False)
    ax.add_collection(LineCollection(frame, colors=MUTED, linewidths=0.7, zorder=1), autolim=False)
    label = {"size": 7, "color": MUTED}
    for k in x:
        ax.text(k, ys[0] - 0.025 * high, _power(k), ha="center", va="top", **label)
    for k in y:
        ax.text(xs[0] - 0.015 * wide, k, _power(k), ha="right", va="center_baseline", **label)
    ax.text(xs[0] + wide / 2, ys[0] - 0.12 * high, panel.xlabel, ha="center", va="top", size=7.5, color=MUTED)
    ax.text(xs[0], ys[1] + 0.035 * high, panel.title, size=8.5, color=INK)


def _ticks(lo: float, hi: float) -> list[float]:
    """Whole decades, at most seven; halves where less than two whole ones fit."""
    every = max(1, math.ceil((hi - lo) / 6))
    ticks = [k for k in range(math.ceil(lo), math.floor(hi) + 1) if k % every == 0]
    return ticks if len(ticks) > 1 else [k / 2 for k in range(math.ceil(2 * lo), math.floor(2 * hi) + 1)]


def _power(k: float) -> str:
    return f"1e{int(k)}" if k == int(k) else f"{10 ** (k - math.floor(k)):.1f}e{math.floor(k)}"


def _svg(fig, salt: str) -> str:
    from matplotlib import rc_context
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    settings = {"svg.hashsalt": salt, "svg.fonttype": "none", "font.family": "DejaVu Sans", "text.usetex": False}
    with rc_context(settings), io.StringIO() as out:
        FigureCanvasSVG(fig).print_svg(out, metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
        text = out.getvalue()
    text = text[text.index("<svg"):].strip()
    text = re.sub(r"<defs>\s*<style.*?</style>\s*</defs>", "", text, flags=re.S)
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.S)
    text = re.sub(r"<!--.*?-->\s*", "", text, flags=re.S)
    text = re.sub(r"(\d\.\d{2})\d+", r"\1", text)                  # a hundredth of a point is not seen
    text = re.sub(r'font: ([\d.]+)px [^;"]*', r"font: \1px system-ui, sans-serif", text)
    text = re.sub(r' (width|height)="[\d.]+pt"', "", text, count=2)
    return re.sub(r"\s*\n\s*", "\n", text).replace(' version="1.1"', "")


def inline(svg: str, names: dict[int, str], label: str) -> str:
    """`svg` for the page: colours become the page's variables, lines carry their method's name and class."""
    for colour, variable in _TONES.items():
        svg = svg.replace(colour, variable)
    named = lambda m: f'<g class="s s{m[1]}"><title>{html(names[int(m[1])])}</title>'
    svg = re.sub(r'<g id="s(\d+)">', named, svg)
    svg = re.sub(r' id="(?:figure|axes|patch|text|[xy]tick|line2d|matplotlib|PolyColl|FillBetween)[^"]*"', "", svg)
    return svg.replace("<svg ", f'<svg role="img" aria-label="{html(label)}" ', 1)


def sheet(panels: list[str], legend: list[tuple[str, Look, bool]], title: str) -> str:
    """Panels side by side with their legend: one standalone SVG for a talk or a paper."""
    from nsbench.report.style import SHAPES
    wide, high = 252, 198
    across = min(3, max(1, len(panels)))
    rows = -(-len(panels) // across)
    per = max(1, across * wide // 190)
    below = 14 * -(-len(legend) // per)
    width, height = across * wide, 24 + rows * high + below + 8
    parts = [f'<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" width="{width}" '
             f'height="{height}" viewBox="0 0 {width} {height}" font-family="system-ui, sans-serif">',
             f'<rect width="{width}" height="{height}" fill="#ffffff"/>',
             f'<text x="8" y="16" font-size="11" fill="{INK}">{html(title)}</text>']
    for i, svg in enumerate(panels):
        svg = re.sub(r' id="s(\d+)"', "", svg).replace(PAPER, "#ffffff")
        parts.append(svg.replace("<svg ", f'<svg x="{i % across * wide}" y="{24 + i // across * high}" width="{wide}" '
                                          f'height="{high}" ', 1))
    for i, (name, look, hollow) in enumerate(legend):
        x, y = 8 + i % per * 190, 24 + rows * high + 14 * (i // per)
        parts.append(f'<g transform="translate({x} {y})"><path d="{SHAPES[look.marker]}" stroke="{look.colour}" fill="'
                     f'{"none" if hollow else look.colour}"/><text x="16" y="9" font-size="8" fill="{INK}">'
                     f'{html(name)}</text></g>')
    return "\n".join([*parts, "</svg>\n"])
