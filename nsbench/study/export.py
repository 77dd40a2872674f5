"""Rows of a study for other tools: xarray, LaTeX and a short table in HTML."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

import numpy as np

from nsbench import columns
from nsbench.html_summary import rows_table

if TYPE_CHECKING:
    import xarray

KEYS = ("case", "solver", "asked")  # what names a row; axes of a data set
LATEX_COLUMNS = ("state_sup", "impulse", "seconds")
MAX_HTML_ROWS = 20  # pairs of case and solver
TEX_ESCAPES = {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    **{c: f"\\{c}" for c in "&%$#_{}"},
}


def to_xarray(rows: Sequence[dict]) -> xarray.Dataset:
    """Arrange the numbers of rows over case, solver and accuracy asked, with units; NaN: no run.

    Words (status, why, ...) are variables of objects, "" where there is no run. Raises ImportError
    if xarray is not installed, ValueError if two rows have the same case, solver and accuracy.
    """
    if find_spec("xarray") is None:
        raise ImportError("to_xarray needs the package xarray: pip install 'nsbench[xarray]'")
    import xarray

    axes = {name: list(dict.fromkeys(row[name] for row in rows)) for name in KEYS}
    axes["asked"] = sorted(axes["asked"])
    place = {name: {value: k for k, value in enumerate(axes[name])} for name in KEYS}
    index = [tuple(place[name][row[name]] for name in KEYS) for row in rows]
    if len(set(index)) < len(index):
        raise ValueError("two rows have the same case, solver and accuracy; they are no array")
    shape = tuple(len(axes[name]) for name in KEYS)
    variables = {}
    for name in dict.fromkeys(n for row in rows for n in row if n not in KEYS):
        column = columns.describe(name)
        notes = {"long_name": column.meaning, "units": column.unit}
        variables[name] = (KEYS, _array(rows, index, name, shape), notes)
    return xarray.Dataset(variables, coords=axes)


def _array(rows: Sequence[dict], index: list[tuple], name: str, shape: tuple) -> np.ndarray:
    """Return one column as an array over the axes."""
    values = [row.get(name) for row in rows]
    is_word = any(isinstance(v, str) for v in values)
    out = np.full(shape, "" if is_word else math.nan, dtype=object if is_word else float)
    for at, value in zip(index, values, strict=True):
        if value is not None:
            out[at] = value
    return out


def to_latex(
    rows: Sequence[dict], names: Sequence[str] = LATEX_COLUMNS, digits: int = 3
) -> str:
    """Write rows as a LaTeX tabular: case, solver, accuracy, and the columns `names`.

    Numbers have `digits` significant digits; an error below its floor is "< floor"; what is not a
    number is a dash. Raises LookupError for
    a column that no row has.
    """
    known = {n for row in rows for n in row}
    for name in names:
        if name not in known:
            raise LookupError(f"no column {name!r} in these rows")
    head = " & ".join(_tex(name) for name in (*KEYS, *names))
    lines = [
        " & ".join(_cell(row, name, digits) for name in (*KEYS, *names)) + r" \\"
        for row in rows
    ]
    layout = "ll" + "r" * (1 + len(names))
    body = "\n".join(lines)
    return (
        f"\\begin{{tabular}}{{{layout}}}\n\\hline\n{head} \\\\\n\\hline\n{body}\n\\hline\n"
        "\\end{tabular}"
    )


def _cell(row: dict, name: str, digits: int) -> str:
    """Format a cell: words escaped, numbers as numbers or powers of ten, errors below floors."""
    value = row.get(name)
    if value is None or value == "":
        return "--"
    if isinstance(value, (str, bool)):
        return _tex(str(value))
    number = float(value)
    if not math.isfinite(number):
        return "--"
    floor = _floor(row, name)
    below = "< " if abs(number) < floor else ""
    text = f"{floor if below else number:.{digits}g}"
    mantissa, e, power = text.partition("e")
    written = f"{below}{mantissa} \\cdot 10^{{{int(power)}}}" if e else f"{below}{text}"
    return f"${written}$" if e or below else text


def _floor(row: dict, name: str) -> float:
    """Return the floor of an error, below which only that of its reference is measured; else 0."""
    floor = row.get(columns.describe(name).floor)
    return floor if isinstance(floor, float) and math.isfinite(floor) else 0.0


def _tex(text: str) -> str:
    return "".join(TEX_ESCAPES.get(c, c) for c in text)


def to_html(rows: Sequence[dict], title: str) -> str:
    """Return a table with a line per case and solver: runs, statuses, smallest state error."""
    pairs: dict[tuple[str, str], list[dict]] = {}
    for row in rows:
        pairs.setdefault((row["case"], row["solver"]), []).append(row)
    lines = [_pair_line(*pair, mine) for pair, mine in list(pairs.items())[:MAX_HTML_ROWS]]
    if len(pairs) > MAX_HTML_ROWS:
        lines.append(("...", f"{len(pairs) - MAX_HTML_ROWS} more", "", "", ""))
    return rows_table(title, ("case", "solver", "runs", "statuses", "best state error"), lines)


def _pair_line(case: str, solver: str, rows: list[dict]) -> tuple:
    """Return the cells of one case and solver."""
    statuses = Counter(str(row["status"]) for row in rows)
    found = [float(row.get("state_sup", math.nan)) for row in rows]
    errors = [e for e in found if math.isfinite(e)]
    best = f"{min(errors):.2g}" if errors else "-"
    words = ", ".join(f"{n} {status}" for status, n in statuses.most_common())
    return case, solver, len(rows), words, best
