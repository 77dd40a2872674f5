"""Chart: a specification of Vega-Lite with its data, shown in notebooks and written to files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from nsbench.report.charts.files import draw_svg, write_chart

NOTEBOOK_VERSION = "v5"  # of Vega-Lite, which notebooks bring along
NOTEBOOK_MIME = f"application/vnd.vegalite.{NOTEBOOK_VERSION}+json"
NOTEBOOK_SCHEMA = f"https://vega.github.io/schema/vega-lite/{NOTEBOOK_VERSION}.json"


@dataclass(frozen=True, repr=False)
class Chart:
    """A chart that stands alone: `spec` is a specification of Vega-Lite with its data.

    Raises ValueError if there is nothing to draw.
    """

    spec: dict

    def __post_init__(self):
        if not self.spec["datasets"]["points"]:
            raise ValueError("nothing to draw: no run has a number for this chart")

    def __repr__(self) -> str:
        """Return the number of points that are drawn; the specification is an attribute.

        The error of the reference is a line or a band of the chart, no point.
        """
        rows = self.spec["datasets"]["points"]
        points = [row for row in rows if row.get("kind") not in ("floor", "far_floor")]
        return f"Chart({len(points)} points)"

    def _repr_mimebundle_(self, include: object = None, exclude: object = None) -> dict:
        """Return the chart as notebooks show it: interactive, or as SVG where they cannot."""
        return {
            NOTEBOOK_MIME: {**self.spec, "$schema": NOTEBOOK_SCHEMA},
            "image/svg+xml": draw_svg(self.spec),
            "text/plain": repr(self),
        }

    def save(self, path: str | Path) -> Path:
        """Write the chart as .svg, .pdf or .json, by the ending of `path`, and return the path.

        Raises ValueError for another ending.
        """
        return write_chart(self.spec, path)
