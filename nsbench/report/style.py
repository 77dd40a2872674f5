"""Define how the report looks and reads: colours, markers of methods, formats, escaping."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass

# Okabe & Ito (2008): distinguishable with any of the common colour blindnesses. Ink stands for
# their black; violet is a ninth one, for as many methods. DARK: the same on a dark page.
PALETTE = (
    "#0072b2",
    "#d55e00",
    "#009e73",
    "#cc79a7",
    "#e69f00",
    "#56b4e9",
    "#1c1b1a",
    "#b8a800",
    "#7b4fb0",
)
DARK = (
    "#4aa8e0",
    "#ff8a4c",
    "#2fc79c",
    "#e39cc3",
    "#f0b429",
    "#8ccdf2",
    "#e6e3dc",
    "#ece14a",
    "#b99be6",
)
INK = "#1c1b1a"
MUTED = "#77736c"
RULE = "#dcd7ce"
SHADE = "#efebe3"
PAPER = "#fdfcfa"
# Colours of the page, by the names of the CSS custom properties
LIGHT_THEME = {
    "paper": PAPER,
    "ink": INK,
    "muted": MUTED,
    "rule": RULE,
    "shade": SHADE,
    "flag": "#8a4b00",
    "flagbg": "#fdf0d9",
    "bad": "#a3241b",
    "badbg": "#fbe9e6",
    "link": "#0b5c91",
}
DARK_THEME = {
    "paper": "#16171a",
    "ink": "#e6e3dc",
    "muted": "#9a968d",
    "rule": "#34353a",
    "shade": "#222429",
    "flag": "#f3c77c",
    "flagbg": "#3a2d14",
    "bad": "#ff9d92",
    "badbg": "#3c1f1c",
    "link": "#7cc0ee",
}
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "<", ">")
LINES = ("-", "--", "-.", ":", "-..")
SHAPES = {
    "o": "M6 2a4 4 0 1 0 .01 0z",
    "s": "M2.5 2.5h7v7h-7z",
    "^": "M6 1.5l4.5 8.5h-9z",
    "D": "M6 1l5 5-5 5-5-5z",
    "v": "M6 10.5l4.5-8.5h-9z",
    "P": "M4.5 1.5h3v3h3v3h-3v3h-3v-3h-3v-3h3z",
    "X": "M3.5 1.5L6 4l2.5-2.5 2 2L8 6l2.5 2.5-2 2L6 8l-2.5 2.5-2-2L4 6 1.5 3.5z",
    "<": "M1.5 6l8.5-4.5v9z",
    ">": "M10.5 6L2 1.5v9z",
}
TIMES = "\u00d7"  # multiplication sign, before a factor
# the talk's method: first in every list, and the one speeds are compared with
LEADING_METHOD = "pbd"


@dataclass(frozen=True)
class Look:
    """Colour by method, marker and dashes by variant.

    ``pbd`` and ``pbd[order=reverse]`` share a colour. index: number within the page. tone: index in
    PALETTE. marker: key of SHAPES. line: key of svg_plots.DASHES.
    """

    index: int
    tone: int
    marker: str
    line: str

    @property
    def colour(self) -> str:
        return PALETTE[self.tone]


def method_of(spec: str) -> str:
    """Return the method of a spec: ``pbd`` of ``pbd[order=reverse]``."""
    return spec.partition("[")[0]


def assign_looks(specs: Iterable[str]) -> dict[str, Look]:
    """Assign one look to each spec, the same on every page with the same specs.

    The position in `specs` becomes the index.
    """
    specs = list(specs)
    families = sorted({method_of(s) for s in specs}, key=lambda f: (f != LEADING_METHOD, f))
    variants = {f: sorted(s for s in specs if method_of(s) == f) for f in families}
    out = {}
    for index, spec in enumerate(specs):
        position = families.index(method_of(spec))
        variant = variants[method_of(spec)].index(spec)
        round_trip = position // len(
            PALETTE
        )  # with more methods than colours, other markers distinguish them
        out[spec] = Look(
            index,
            position % len(PALETTE),
            MARKERS[(variant + position + 4 * round_trip) % len(MARKERS)],
            LINES[(variant + round_trip) % len(LINES)],
        )
    return out


def format_number(value: float | None, digits: int = 2) -> str:
    """Format a number as people type it: 0, 3.4e-5, 0.012, 12; ``not finite`` for NaN and infinity.

    digits: significant ones; 3.0e-4 was rounded to two digits, 3e-4 has one.
    """
    if value is None or not math.isfinite(value):
        return "not finite"
    if math.isclose(
        value, float(f"{value:.0e}"), rel_tol=1e-9
    ):  # interpolated values carry rounding
        digits = 1
    mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
    k = int(exponent)
    if value == 0 or -2 <= k <= 3:
        return f"{float(f'{mantissa}e{k}'):.{max(0, digits - 1 - k)}f}"
    return f"{mantissa}e{k}"


def format_power(value: float) -> str:
    """Format an error to be reached, always with its exponent: 1e-2."""
    mantissa, exponent = (
        f"{value:g}".split("e") if "e" in f"{value:g}" else f"{value:.0e}".split("e")
    )
    return f"{mantissa}e{int(exponent)}"


def format_seconds(value: float | None) -> str:
    """Format a duration with its unit: 12 us, 3.4 ms, 2.1 s."""
    if value is None or not math.isfinite(value):
        return "not timed"
    scale, unit = (1.0, "s") if value >= 1.0 else (1e-3, "ms") if value >= 1e-3 else (1e-6, "µs")
    return f"{format_number(value / scale)} {unit}"


def format_timing(seconds: float, loop: str) -> str:
    """Format a duration, and say where a loop in Python took it: ``89 ms (host loop)``."""
    return f"{format_seconds(seconds)}{' (host loop)' if loop == 'host' else ''}"


def format_factor(value: float) -> str:
    """Format a ratio with two digits, without false precision: 0.38, 4.1, 130."""
    return format_number(value) if value < 100 else f"{float(f'{value:.2g}'):.0f}"


def sanitise(text: object, limit: int = 600) -> str:
    """Make text from names and sentences harmless for any terminal, table or page.

    Control characters (ANSI escapes, newlines) and bidirectional overrides become visible escapes;
    text beyond `limit` characters is cut with an ellipsis. Markup is escaped where it is written:
    by Jinja2, `escape` and `escape_markdown`.
    """
    text = re.sub(
        r"[\x00-\x1f\x7f-\x9f\u200b-\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff\ufeff]",
        lambda m: f"\\x{ord(m[0]):02x}",
        str(text),
    )
    return text if len(text) <= limit else text[: limit - 1] + "…"


def escape(text: object) -> str:
    """Escape `text` for element content and for quoted attributes of the SVG drawn here."""
    for raw, safe in (
        ("&", "&amp;"),
        ("<", "&lt;"),
        (">", "&gt;"),
        ('"', "&quot;"),
        ("'", "&#39;"),
    ):
        text = str(text).replace(raw, safe)
    return text


def escape_markdown(text: object) -> str:
    """Escape `text` for a Markdown table cell: no markup, no column break."""
    text = re.sub(r"\s+", " ", escape(text).replace("&#39;", "'").replace("&quot;", '"'))
    return re.sub(r"([\\`*_\[\]|~])", r"\\\1", text)


def file_stem(text: str) -> str:
    """Turn `text` into a file name and an id: letters, digits, ``.``, ``_`` and ``-``.

    At most 100 characters; "case" for a text without any of these.
    """
    return re.sub(r"[^A-Za-z0-9._-]+", "_", text).strip("_.")[:100] or "case"


def join_names(items: Iterable[str], limit: int = 6) -> str:
    """Join names: ``a, b and c``; beyond `limit` names the rest is counted."""
    items = list(items)
    if len(items) > limit:
        items = [*items[: limit - 1], f"{len(items) - limit + 1} more"]
    return " and ".join(filter(None, (", ".join(items[:-1]), items[-1]))) if items else "none"


def format_count(n: int, word: str) -> str:
    """Format a number of things: ``1 case``, ``3 cases``."""
    return (
        f"{n} {word}"
        if n == 1
        else f"{n} {word[:-1] + 'ies' if word.endswith('y') else word + 's'}"
    )
