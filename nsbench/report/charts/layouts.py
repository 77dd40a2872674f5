"""Layouts of the interactive charts: Vega-Lite specifications without data.

Every chart takes the rows of the data set "points". A click on the legend picks methods and greys
the others, the wheel zooms, a rectangle is dragged; hovering names the values. `methods` in all
functions: pairs (name, look), which fix colour, dashes and marker over the whole page.
"""

from __future__ import annotations

from nsbench.report.style import PALETTE, Look
from nsbench.report.svg_plots import DASHES

SCHEMA = "https://vega.github.io/schema/vega-lite/v6.json"
HEIGHT = 360
DIMMED = 0.08  # opacity of the methods that are not picked
MARKS = {  # Vega's names of the markers of style.SHAPES, where it has them
    "o": "circle",
    "s": "square",
    "^": "triangle-up",
    "D": "diamond",
    "v": "triangle-down",
    "P": "cross",
    "<": "triangle-left",
    ">": "triangle-right",
}
# the others as paths around the origin, of the size that Vega's shapes have
PATHS = {"X": "M-1-.6L-.6-1 0-.4.6-1 1-.6.4 0 1 .6.6 1 0 .4-.6 1-1 .6-.4 0Z"}

# columns of the quantities that are charted, but for multipliers: impulse, or reaction
METRICS = {"state": "state_sup", "violation": "feasibility", "selection": "selection"}

Methods = list[tuple[str, Look]]
Spec = dict


def error_chart(methods: Methods, x_title: str, y_title: str) -> Spec:
    """Lay out errors over a step or a cost, both logarithmic.

    points: rows with method, x, y, kind and tip fields methods (all whose marks coincide), h,
    seconds, status, bar, why. kind: "error";
    "zero", an error of exactly 0, drawn at the bottom edge; "failed", a run without a number,
    crossed at the top edge; "floor", whose y is the error of the reference, shaded below, and
    "far_floor", to which the chart does not reach, both with a label for the legend; "level",
    the best error y of a method with a tolerance, drawn across where x is a step. bar: the error
    bar in words (see without_bar_tips).
    """
    x = _logarithmic("x", x_title)
    y = _logarithmic("y", y_title)
    line = {"color": _colour(methods), "opacity": _opacity()}
    point = {"x": x, **_identity(methods), "tooltip": RUN_TIPS}
    failed = [*RUN_TIPS, {"field": "why"}]
    floor = {"type": "rect", "opacity": 0.18}
    edge = {"value": HEIGHT}
    spec = _chart(
        [
            _layer("floor", floor, {"y": y, "y2": edge, "fill": BAND}),
            _layer("far_floor", floor, {"y": edge, "y2": edge, "fill": BAND}),
            {
                # the first layer with a legend: only there can the legend be clicked
                "params": [PICK, ZOOM],
                **_layer(
                    "error",
                    {"type": "line", "strokeWidth": 1.6, "strokeJoin": "round"},
                    {
                        "x": x,
                        "y": y,
                        "order": {"field": "h"},
                        "strokeDash": _unlisted(_dashes(methods)),
                        **line,
                    },
                ),
            },
            _layer("error", {"type": "point", "size": 34, "filled": True}, {"y": y, **point}),
            _layer(
                "level",
                {"type": "rule", "strokeDash": [2, 3], "strokeWidth": 1.6},
                {"y": y, **line, "tooltip": RUN_TIPS},
            ),
            _layer(
                "zero",
                {"type": "point", "size": 34, "filled": False},
                {"y": {"value": HEIGHT}, **point},
            ),
            _layer(
                "failed",
                {"type": "text", "text": "×", "fontSize": 14},
                {"x": x, "y": {"value": 6}, **line, "tooltip": failed},
            ),
        ]
    )
    return _list_markers(spec)


def without_bar_tips(layers: list[Spec]) -> list[Spec]:
    """Remove the error bars from the tooltips, for a chart whose runs have none."""
    kept = []
    for layer in layers:
        encoding = dict(layer["encoding"])
        if "tooltip" in encoding:
            encoding["tooltip"] = [tip for tip in encoding["tooltip"] if tip != BAR_TIP]
        kept.append({**layer, "encoding": encoding})
    return kept


def profile_chart(methods: Methods) -> Spec:
    """Lay out performance profiles: the share of the cases solved within a factor of the fastest.

    points: rows with method, x (factor), y (share). Source: Dolan & More (2002), Mathematical
    Programming 91.
    """
    return _chart(
        [
            {
                "params": [PICK, ZOOM],
                "mark": {"type": "line", "interpolate": "step-after", "strokeWidth": 1.8},
                "encoding": {
                    "x": {
                        **_logarithmic("x", "seconds over those of the fastest method"),
                        "axis": {"format": "~g", "tickCount": 6, "labelOverlap": True},
                    },
                    "y": {
                        "field": "y",
                        "type": "quantitative",
                        "scale": {"domain": [0, 1]},
                        "axis": {"format": "%"},
                        "title": "share of the cases solved",
                    },
                    "order": {"field": "x"},
                    "color": _with_long_symbols(_colour(methods)),
                    "strokeDash": _with_long_symbols(_dashes(methods)),
                    "opacity": _opacity(),
                    "tooltip": [
                        {"field": "method"},
                        {"field": "x", "title": "factor", "format": ".3~g"},
                        {"field": "y", "title": "share", "format": ".0%"},
                    ],
                },
            }
        ]
    )


def scatter_chart(x_title: str, y_title: str) -> Spec:
    """Lay out the seconds of two methods against each other, with the line of equal seconds.

    points: rows with case, group (problem class), x, y, kind ("case", or "equal" for the two ends
    of that line).
    """
    group = {
        "field": "group",
        "type": "nominal",
        "scale": {"range": list(PALETTE[:4])},
        "legend": {"title": None, "orient": "bottom"},
    }
    return _beside_equal("case", x_title, y_title, {"color": group}, ["case"], ZOOM)


def error_bar_chart(methods: Methods, x_title: str, y_title: str) -> Spec:
    """Lay out error bars over the errors of the same runs, with the line where they are equal.

    points: rows with method, case, h, x (error), y (error bar), bar ("bound", "estimate"), kind
    ("run", or "equal" for the two ends of that line). Below the line lies a bar that is too small.
    """
    shape = {
        "field": "bar",
        "type": "nominal",
        "scale": {"domain": ["bound", "estimate"], "range": ["circle", "triangle-up"]},
        # grey shows on light and dark pages
        "legend": {"title": None, "orient": "bottom", "symbolFillColor": "#808080"},
    }
    look = {"color": _colour(methods), "shape": shape, "opacity": _opacity()}
    return _beside_equal("run", x_title, y_title, look, ["case", "method", "h", "bar"], PICK, ZOOM)


def _beside_equal(kind: str, x_title: str, y_title: str, look: Spec, tips: list, *params) -> Spec:
    """A chart of one number over another, both logarithmic, and the line where they are equal."""
    x = _logarithmic("x", x_title)
    y = _logarithmic("y", y_title)
    tooltip = [{"field": name} for name in tips]
    tooltip += [
        {"field": "x", "title": x_title, "format": ".3~g"},
        {"field": "y", "title": y_title, "format": ".3~g"},
    ]
    line = {"type": "line", "color": "#808080", "strokeDash": [2, 3]}
    mark = {"type": "point", "size": 60, "filled": True, "opacity": 0.85}
    points = _layer(kind, mark, {"x": x, "y": y, **look, "tooltip": tooltip})
    return _chart([_layer("equal", line, {"x": x, "y": y}), {"params": list(params), **points}])


def order_chart(methods: Methods, title: str, cases: int) -> Spec:
    """Lay out orders of convergence with their 95 % intervals, one line per case.

    points: rows with method, case, x (order), low, high, verdict ("order", or another, whose point
    is hollow). cases: how many, at most.
    """
    y = {"field": "case", "type": "nominal", "title": None, "sort": None}
    y["axis"] = {"grid": True, "labelLimit": 190}
    colour = {"color": _colour(methods), "opacity": _opacity()}
    clear = "datum.verdict === 'order'"
    spec = _chart(
        [
            {
                "params": [PICK],
                "mark": {"type": "rule", "strokeWidth": 1.5},
                "encoding": {
                    "x": {"field": "low", "type": "quantitative"},
                    "x2": {"field": "high"},
                    "y": y,
                    **colour,
                },
            },
            {
                # thin strokes: those of 2 px, the default, fill the arms of a hollow cross
                "mark": {"type": "point", "filled": True, "size": 64, "strokeWidth": 0.8},
                "encoding": {
                    "x": {
                        "field": "x",
                        "type": "quantitative",
                        "scale": {"zero": False},
                        "title": title,
                    },
                    "y": y,
                    **_identity(methods),
                    "stroke": _colour(methods),
                    "fillOpacity": {"condition": {"test": clear, "value": 1.0}, "value": 0.0},
                    "tooltip": [
                        {"field": "case"},
                        {"field": "method"},
                        {"field": "verdict"},
                        {"field": "x", "title": "order", "format": ".3f"},
                        {"field": "low", "format": ".3f"},
                        {"field": "high", "format": ".3f"},
                    ],
                },
            },
        ]
    )
    spec["height"] = 15 * cases
    return spec


def curve_chart(y_title: str) -> Spec:
    """Lay out curves over time: coordinates, multipliers, bounds.

    points: rows with series, t, y.
    """
    return _chart(
        [
            {
                "params": [ZOOM, {**PICK, "select": {"type": "point", "fields": ["series"]}}],
                "mark": {"type": "line", "strokeWidth": 1.6},
                "encoding": {
                    "x": {"field": "t", "type": "quantitative", "title": "time t"},
                    "y": {"field": "y", "type": "quantitative", "title": y_title},
                    "color": {
                        "field": "series",
                        "type": "nominal",
                        "sort": None,
                        "scale": {"range": list(PALETTE)},
                        "legend": {"title": None, "orient": "bottom", "columns": 4},
                    },
                    "opacity": _opacity(),
                    "tooltip": [
                        {"field": "series"},
                        {"field": "t", "format": ".4~g"},
                        {"field": "y", "format": ".4~g"},
                    ],
                },
            }
        ]
    )


PICK = {"name": "pick", "select": {"type": "point", "fields": ["method"]}, "bind": "legend"}
ZOOM = {"name": "zoom", "select": "interval", "bind": "scales"}
BAR_TIP = {"field": "bar", "title": "in the 2-norm"}
RUN_TIPS = [
    {"field": "methods", "title": "method"},
    {"field": "y", "title": "error", "format": ".3~g"},
    {"field": "h", "title": "step, 1/k or tol", "format": ".3~g"},
    {"field": "seconds", "format": ".3~g"},
    {"field": "status"},
    BAR_TIP,
]


def history_chart(methods: Methods, versions: list[str], title: str) -> Spec:
    """Lay out a number of every method over the versions, in their order.

    points: rows with method, version, y.
    """
    x = {"field": "version", "type": "ordinal", "sort": versions, "title": None}
    y = {**_logarithmic("y", title), "axis": {"format": ".3~g", "tickCount": 5}}
    tips = [{"field": "method"}, {"field": "version"}, {"field": "y", "format": ".3~g"}]
    spec = _chart(
        [
            {
                "params": [PICK],
                "mark": {"type": "line", "strokeWidth": 1.6},
                "encoding": {
                    "x": x,
                    "y": y,
                    "strokeDash": _unlisted(_dashes(methods)),
                    "color": _colour(methods),
                    "opacity": _opacity(),
                },
            },
            {
                "mark": {"type": "point", "filled": True, "size": 40},
                "encoding": {"x": x, "y": y, **_identity(methods), "tooltip": tips},
            },
        ]
    )
    return _list_markers(spec)


def _chart(layers: list[Spec]) -> Spec:
    """The frame that all charts share."""
    return {
        "$schema": SCHEMA,
        "data": {"name": "points"},
        "width": "container",
        "height": HEIGHT,
        "autosize": {"type": "fit-x", "contains": "padding"},
        "layer": layers,
        "config": {"view": {"stroke": None}, "axis": {"titleFontWeight": "normal"}},
    }


def _layer(kind: str, mark: Spec, encoding: Spec) -> Spec:
    """A layer of the rows of one kind."""
    only = {"filter": {"field": "kind", "equal": kind}}
    return {"transform": [only], "mark": mark, "encoding": encoding}


def _logarithmic(field: str, title: str) -> Spec:
    """A logarithmic axis; ten pixels at its ends keep markers whole."""
    return {
        "field": field,
        "type": "quantitative",
        "scale": {"type": "log", "nice": False, "padding": 10},
        "title": title,
        "axis": {"format": "~e", "tickCount": 6, "labelOverlap": True, "gridOpacity": 0.45},
    }


def _opacity() -> Spec:
    return {"condition": {"param": "pick", "value": 1.0, "empty": True}, "value": DIMMED}


def _identity(methods: Methods) -> Spec:
    """Colour and marker of the methods, greyed where another one is picked."""
    return {"color": _colour(methods), "shape": _shapes(methods), "opacity": _opacity()}


LEGEND = {"title": None, "orient": "bottom", "columns": 4, "labelLimit": 240}
BAND = {  # of the error of the reference
    "field": "label",
    "type": "nominal",
    "scale": {"range": ["#808080"]},
    "legend": {**LEGEND, "labelLimit": 340, "symbolType": "square", "symbolOpacity": 0.4},
}


def _channel(methods: Methods, values: list) -> Spec:
    return {
        "field": "method",
        "type": "nominal",
        "scale": {"domain": [name for name, _ in methods], "range": values},
        "legend": LEGEND,  # the same for all channels: they share one
    }


def _colour(methods: Methods) -> Spec:
    return _channel(methods, [look.colour for _, look in methods])


def _dashes(methods: Methods) -> Spec:
    dashes = [[float(v) for v in DASHES[look.line].split()] or [1, 0] for _, look in methods]
    return _channel(methods, dashes)


def _with_long_symbols(channel: Spec) -> Spec:
    """Draw the lines of a legend long enough for the longest dashes to repeat."""
    return {**channel, "legend": {**LEGEND, "symbolSize": 900}}


def _unlisted(channel: Spec) -> Spec:
    """Leave dashes out of a legend of markers: their outlines would be dashed too."""
    return {**channel, "legend": None}


def _list_markers(spec: Spec) -> Spec:
    """Keep the dashes, which are unlisted, apart from the legend of colours and markers."""
    return {**spec, "resolve": {"legend": {"strokeDash": "independent"}}}


def _shapes(methods: Methods) -> Spec:
    names = [MARKS.get(look.marker) or PATHS.get(look.marker, "circle") for _, look in methods]
    return _channel(methods, names)
