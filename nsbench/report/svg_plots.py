"""Draw log-log panels as SVG text: a few kilobytes and a millisecond each, reproducible.

Errors of exactly 0 have a place of their own, the bottom edge. Markers are defined once for all
panels of a page or of a sheet (define_markers); the lines only name them.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from nsbench.report.style import (
    INK,
    MUTED,
    PALETTE,
    PAPER,
    RULE,
    SHADE,
    SHAPES,
    Look,
    escape,
    format_number,
)

# units of the viewBox: points of a figure 3.5 inches wide
WIDTH = 252
HEIGHT = 198
LEFT = 34.0
RIGHT = 247.0
TOP = 21.0
BOTTOM = 165.0
LEGEND_WIDTH = 190  # of one entry in the legend of a sheet
DASHES = {"-": "", "--": "4.4 1.9", "-.": "7.7 1.9 1.2 1.9", ":": "1.2 2", "-..": "7 2 1 2 1 2"}
FAR_BELOW_DECADES = 2.0  # a level lower than this below the points is not drawn to scale
MAX_SPAN_DECADES = 18.0  # of a panel: what is lower is rounding of doubles
MIN_SPAN_DECADES = 1.2  # so that a flat line is not magnified noise
MAX_MARKERS = 48  # of a line; more points are thinned evenly, which does not show
HALO = f' stroke="{PAPER}" stroke-width="2.5" paint-order="stroke"'
_TONES = {
    **{c: f"var(--m{i})" for i, c in enumerate(PALETTE)},
    INK: "currentColor",
    MUTED: "var(--muted)",
    RULE: "var(--rule)",
    SHADE: "var(--shade)",
    PAPER: "var(--paper)",
}

Point = tuple[float, float]  # in decades
Points = Iterable[Point]


@dataclass(frozen=True)
class Line:
    """The points of one method.

    x, y (k,): positive, or 0 (a y of 0 is drawn open at the bottom edge). failed: the x of runs
    that gave no number, crossed at the top edge. level: y of a method without an x of this kind,
    drawn across. hollow: open markers (the loop is not compiled). far: errors far below the others
    (of a tolerance, or rounding); they may stay at the bottom edge with their value, so as not to
    press the other lines flat.
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
    """The content of one panel.

    key: part of its file name. floor: shaded below. slopes: guides of these orders.
    """

    key: str
    title: str
    xlabel: str
    lines: tuple[Line, ...]
    floor: float = 0.0
    slopes: tuple[float, ...] = ()


class Pen:
    """Converts decades to units of the viewBox and writes SVG elements as text.

    xs, ys: limits of the panel in decades.
    """

    def __init__(self, xs: tuple[float, float], ys: tuple[float, float]):
        self.xs = xs
        self.ys = ys

    def x(self, decade: float) -> float:
        """Convert a decade to the horizontal coordinate."""
        return LEFT + (RIGHT - LEFT) * (decade - self.xs[0]) / (self.xs[1] - self.xs[0])

    def y(self, decade: float) -> float:
        """Convert a decade to the vertical coordinate, which grows downwards."""
        return BOTTOM - (BOTTOM - TOP) * (decade - self.ys[0]) / (self.ys[1] - self.ys[0])

    def path(self, points: Points, **attributes) -> str:
        """Write a polygon through points (x, y) in decades."""
        d = "M" + "L".join(f"{self.x(a):.1f} {self.y(b):.1f}" for a, b in points)
        return f'<path d="{d}"{_attributes(attributes)}/>'

    def segments(self, pairs: Iterable[tuple[Point, Point]], **attributes) -> str:
        """Write separate segments between pairs of points in decades."""
        d = "".join(
            f"M{self.x(a):.1f} {self.y(b):.1f}L{self.x(c):.1f} {self.y(e):.1f}"
            for (a, b), (c, e) in pairs
        )
        return f'<path d="{d}"{_attributes(attributes)}/>'

    def text(
        self,
        x: float,
        y: float,
        words: str,
        size: float,
        colour: str = MUTED,
        anchor: str = "start",
        down: float = 0.0,
    ) -> str:
        """Write `words` at (x, y) in decades, `down` units lower; those of a line with a halo."""
        halo = "" if colour in (MUTED, INK) else HALO
        return (
            f'<text x="{self.x(x):.1f}" y="{self.y(y) + down:.1f}" font-size="{size}" '
            f'fill="{colour}" text-anchor="{anchor}"{halo}>{escape(words)}</text>'
        )


def _attributes(values: dict) -> str:
    """SVG attributes from keywords; "" leaves one out, and nothing is filled unless asked for."""
    values = {"fill": "none", **values}
    return "".join(f' {k.replace("_", "-")}="{v}"' for k, v in values.items() if v != "")


def draw_panel(panel: Panel) -> str:
    """Draw the panel as an SVG element in the colours of the light page.

    The markers that it names are defined by define_markers; inline_svg adapts it to the page, and
    compose_sheet to a standalone file.
    """
    xs, ys = _limits(panel)
    pen = Pen(xs, ys)
    x = _ticks(*xs)
    y = _ticks(*ys)
    grid = [((k, ys[0]), (k, ys[1])) for k in x] + [((xs[0], k), (xs[1], k)) for k in y]
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}">',
        pen.segments(grid, stroke=RULE, stroke_width=0.5),
    ]
    if panel.floor > 0 and math.log10(panel.floor) > ys[0]:
        top = min(math.log10(panel.floor), ys[1])
        parts += [
            pen.path([(xs[0], ys[0]), (xs[0], top), (xs[1], top), (xs[1], ys[0])], fill=SHADE),
            pen.text(xs[1], top, "reference floor", 6.5, anchor="end", down=7),
        ]
    parts.append(
        pen.path([(xs[0], ys[1]), (xs[0], ys[0]), (xs[1], ys[0])], stroke=MUTED, stroke_width=0.7)
    )
    for p in panel.slopes:
        parts += _guide(pen, p, panel)
    below = [line.far or (line.level >= 0 and line.level < 10.0 ** ys[0]) for line in panel.lines]
    # lines whose value is written come last: no marker of another one covers it
    drawn = sorted(range(len(below)), key=below.__getitem__)
    parts += [_line(pen, panel.lines[i], sum(below[:i])) for i in drawn]
    parts += [pen.text(k, ys[0], _power(k), 7, anchor="middle", down=9) for k in x]
    parts += [
        f'<text x="{LEFT - 3}" y="{pen.y(k) + 2.5:.1f}" font-size="7" fill="{MUTED}" '
        f'text-anchor="end">'
        f"{_power(k)}</text>"
        for k in y
    ]
    parts += [
        pen.text((xs[0] + xs[1]) / 2, ys[0], panel.xlabel, 7.5, anchor="middle", down=21),
        pen.text(xs[0], ys[1], panel.title, 8.5, INK, down=-6),
        "</svg>",
    ]
    return "\n".join(parts)


def _limits(panel: Panel):
    """Compute the limits in decades, (x0, x1) and (y0, y1), a little beyond the data.

    Zeros and failures get their edges. What lies far below the other lines, a level, a floor or
    errors of a far line, stays at the bottom edge.
    """
    x = np.concatenate(
        [np.concatenate([line.x, line.failed]) for line in panel.lines] or [np.ones(1)]
    )
    near = [line.y for line in panel.lines if not line.far and np.any(line.y > 0)]
    rest = [line.y for line in panel.lines if line.far] if near else []
    points = np.concatenate(near or [line.y for line in panel.lines])
    levels = np.concatenate([[line.level for line in panel.lines], *rest])
    x, points, levels = (np.log10(v[np.isfinite(v) & (v > 0)]) for v in (x, points, levels))
    x = x if x.size else np.zeros(1)
    y = points if points.size else levels if levels.size else np.zeros(1)
    low = float(y.min())
    high = float(y.max())
    for level in (*levels, math.log10(panel.floor) - 0.3 if panel.floor > 0 else low):
        low = min(low, level) if level > low - FAR_BELOW_DECADES else low
    high = max(high, *levels) if levels.size else high
    low = max(low, high - MAX_SPAN_DECADES)
    if high - low < MIN_SPAN_DECADES:
        middle = (low + high) / 2
        low = middle - MIN_SPAN_DECADES / 2
        high = middle + MIN_SPAN_DECADES / 2
    zero = any(np.any(line.y == 0) for line in panel.lines)
    below = zero or (levels.size and levels.min() < low)
    pad = 0.05 * max(float(np.ptp(x)), 1.0)
    room = 0.06 * (high - low)
    return (float(x.min()) - pad, float(x.max()) + pad), (
        low - room * (2.5 if below else 1),
        high + room * 1.5,
    )


def _line(pen: Pen, line: Line, place: int) -> str:
    """Draw one method: polygon with markers, zeros at the bottom, failures at the top, its level.

    place: the number of values already written where the value of a line below the panel goes.
    """
    (x0, x1), (low, high), k = pen.xs, pen.ys, line.look.index
    stroke = {"stroke": line.look.colour, "stroke_width": 1.2}
    at = np.unique(np.linspace(0, len(line.x) - 1, min(len(line.x), MAX_MARKERS)).astype(int))
    x = line.x[at]
    y = line.y[at]
    solid = (y > 0) & (x > 0)
    out = [f'<g id="s{k}">']
    if solid.any():
        y10 = np.clip(np.log10(y[solid]), low, high)
        out.append(
            pen.path(
                zip(np.log10(x[solid]), y10, strict=True),
                **stroke,
                style=marker_style("o" if line.hollow else "m", k),
                stroke_dasharray=DASHES[line.look.line],
            )
        )
        if line.far and np.log10(y[solid]).min() < low:
            i = int(np.argmin(y[solid]))
            out.append(
                pen.text(
                    np.log10(x[solid][i]),
                    low,
                    format_number(float(y[solid][i])),
                    6.5,
                    line.look.colour,
                    "middle",
                    -6 - 7 * place,
                )
            )
    if np.any(y == 0):
        out.append(pen.path([(a, low) for a in np.log10(x[y == 0])], style=marker_style("o", k)))
    if line.failed.size:
        out.append(
            pen.path(
                [(a, high) for a in np.log10(line.failed[:MAX_MARKERS])], style=marker_style("x", k)
            )
        )
    if line.level >= 0:
        level = math.log10(line.level) if line.level else -math.inf
        out.append(
            pen.path(
                [(x0, max(level, low)), (x1, max(level, low))],
                **stroke,
                stroke_dasharray=DASHES[":"],
            )
        )
        if level < low:
            out.append(
                pen.text(
                    x0, low, format_number(line.level), 6.5, line.look.colour, down=-3 - 7 * place
                )
            )
    return "".join([*out, "</g>"])


def marker_style(kind: str, index: int) -> str:
    """Name the markers of a line: kind m (full), o (open) or x (cross) of the look `index`."""
    return f"marker:url(#{kind}:{index})"


def define_markers(looks: Iterable[Look]) -> str:
    """Define the markers that panels name: full (m), open (o) and cross (x) of every look."""
    out = []
    for look in looks:
        shape = SHAPES[look.marker]
        cross = "M2 2l8 8M10 2l-8 8"
        for kind, d, fill in (("m", shape, look.colour), ("o", shape, PAPER), ("x", cross, "none")):
            out.append(
                f'<marker id="{kind}:{look.index}" viewBox="0 0 12 12" refX="6" refY="6" '
                'markerWidth="5.4" markerHeight="5.4" markerUnits="userSpaceOnUse" '
                f'overflow="visible"><path d="{d}" fill="{fill}" stroke="{look.colour}" '
                f'stroke-width="{2.2 if kind == "x" else 1.8}"/></marker>'
            )
    return f"<defs>{''.join(out)}</defs>"


def _guide(pen: Pen, p: float, panel: Panel) -> list[str]:
    """Draw a triangle of slope p in a lower corner: one decade across, or less in a small panel."""
    (x0, x1), (y0, y1), k = pen.xs, pen.ys, panel.slopes.index(p)
    width = min(1.0, 0.18 * (x1 - x0))
    height = min(p * width, 0.35 * (y1 - y0))
    width = height / p
    right = x1 - 0.03 * (x1 - x0) - k * 0.24 * (x1 - x0)
    bottom = y0 + 0.08 * (y1 - y0)
    if panel.floor > 0:
        bottom = max(bottom, math.log10(panel.floor) + 0.03 * (y1 - y0))
    corners = [
        (right - width, bottom),
        (right, bottom),
        (right, bottom + height),
        (right - width, bottom),
    ]
    return [
        pen.path(corners, stroke=MUTED, stroke_width=0.7),
        pen.text(right - width / 2, bottom, f"order {p:g}", 6.5, anchor="middle", down=7),
    ]


def _ticks(lo: float, hi: float) -> list[float]:
    """List whole decades, at most seven; halves where less than two whole ones fit."""
    every = max(1, math.ceil((hi - lo) / 6))
    ticks = [k for k in range(math.ceil(lo), math.floor(hi) + 1) if k % every == 0]
    return (
        ticks
        if len(ticks) > 1
        else [k / 2 for k in range(math.ceil(2 * lo), math.floor(2 * hi) + 1)]
    )


def _power(k: float) -> str:
    """10^k for a tick at a whole or half decade."""
    return f"1e{int(k)}" if k == int(k) else f"{10 ** (k - math.floor(k)):.1f}e{math.floor(k)}"


def inline_svg(svg: str, names: dict[int, str], label: str, is_hidden: bool = False) -> str:
    """Adapt an SVG element to the page.

    Colours become the page's variables, lines carry their method's name. names: by index of the
    look. label: for screen readers; is_hidden: from which the element is hidden.
    """
    svg = svg.replace(HALO, ' class="value"')
    for colour, variable in _TONES.items():
        svg = svg.replace(colour, variable)
    named = lambda m: f'<g><title>{escape(names[int(m[1])])}</title>'
    svg = re.sub(r'<g id="s(\d+)">', named, svg)
    # the policy of the page allows no style attributes: the page has classes of this name
    svg = re.sub(r'style="marker:url\(#(\w):(\d+)\)"', r'class="\1-\2"', svg)
    role = 'aria-hidden="true"' if is_hidden else f'role="img" aria-label="{escape(label)}"'
    return svg.replace("<svg ", f"<svg {role} ", 1)


def compose_sheet(panels: list[str], legend: list[tuple[str, Look, bool]], title: str) -> str:
    """Put panels side by side with their legend: one standalone SVG for a talk or a paper.

    legend: (method, look, open markers).
    """
    columns = min(3, max(1, len(panels)))
    rows = -(-len(panels) // columns)
    per_row = max(1, columns * WIDTH // LEGEND_WIDTH)
    below = 14 * -(-len(legend) // per_row)
    width = columns * WIDTH
    height = 24 + rows * HEIGHT + below + 8
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" viewBox="0 0 '
        f'{width} {height}" font-family="system-ui, sans-serif">',
        define_markers([look for _, look, _ in legend]).replace(PAPER, "#ffffff"),
        f'<rect width="{width}" height="{height}" fill="#ffffff"/>',
        f'<text x="8" y="16" font-size="11" fill="{INK}">{escape(title)}</text>',
    ]
    for i, svg in enumerate(panels):
        svg = re.sub(r' id="s(\d+)"', "", svg).replace(PAPER, "#ffffff")
        place = f'x="{i % columns * WIDTH}" y="{24 + i // columns * HEIGHT}" '
        size = f'width="{WIDTH}" height="{HEIGHT}" '
        parts.append(svg.replace("<svg ", f"<svg {place}{size}", 1))
    for i, (name, look, hollow) in enumerate(legend):
        x = 8 + i % per_row * LEGEND_WIDTH
        y = 24 + rows * HEIGHT + 14 * (i // per_row)
        parts.append(
            f'<g transform="translate({x} {y})"><path d="M0 6h28" fill="none" '
            f'stroke="{look.colour}" stroke-dasharray="{DASHES[look.line]}"/><path '
            f'transform="translate(8 0)" d="{SHAPES[look.marker]}" stroke="{look.colour}" '
            f'fill="{PAPER if hollow else look.colour}"/><text x="34" y="9" font-size="8" '
            f'fill="{INK}">{escape(name)}</text></g>'
        )
    return "\n".join([*parts, "</svg>\n"])
