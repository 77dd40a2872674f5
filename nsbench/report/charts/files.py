"""Charts outside of the page: SVG, PDF and JSON files, and the library that draws in a browser.

vl-convert holds Vega-Lite, Vega and vega-embed and draws without a browser: the same specification
gives the same bytes. It is imported here alone, when a file or a page is written.
"""

from __future__ import annotations

import functools
import json
import re
from pathlib import Path

from nsbench.results.atomic_write import replace

WIDTH = 640  # of a chart in a file; in a page it fills its column
FORMATS = (".svg", ".pdf", ".json")


@functools.cache
def chart_library() -> str:
    """Return the JavaScript of Vega, Vega-Lite and vega-embed as one script, without requests."""
    import vl_convert

    return vl_convert.javascript_bundle()


def with_data(layout: dict, rows: list[dict]) -> dict:
    """Put rows into a layout of nsbench.report.charts.layouts; the result stands alone."""
    return {**layout, "width": WIDTH, "datasets": {"points": rows}}


def write_chart(spec: dict, path: str | Path) -> Path:
    """Write a chart as .svg, .pdf or .json (the specification), by the ending of `path`.

    The same specification gives the same bytes. Raises ValueError for another ending.
    """
    path = Path(path)
    if path.suffix not in FORMATS:
        raise ValueError(f"{path}: a chart is written as {', '.join(FORMATS)}")
    replace(path, _encode(spec, path.suffix))
    return path


def draw_svg(spec: dict) -> str:
    """Draw a chart as SVG text."""
    import vl_convert

    svg = vl_convert.vegalite_to_svg(spec)
    # Vega counts clips and gradients over all charts of a process; here every chart counts its own
    names: dict[str, str] = {}
    number = lambda m: names.setdefault(m[0], f"{m[1]}{len(names)}")
    return re.sub(r"\b(clip|gradient_)\d+\b", number, svg)


def _encode(spec: dict, suffix: str) -> bytes:
    if suffix == ".json":
        return json.dumps(spec, indent=1, sort_keys=True).encode()
    svg = draw_svg(spec)
    if suffix == ".svg":
        return svg.encode()
    import vl_convert

    # the converter writes resources of a page in the order of a hash table
    in_order = lambda m: b"".join(sorted(m[0].splitlines(True)))
    return re.sub(rb"(?m)(?:^ +/\w+ \d+ 0 R\n)+", in_order, vl_convert.svg_to_pdf(svg))
