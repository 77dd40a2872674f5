"""Spreads of the facts of a study under perturbed starts, the tolerances of a baseline.

They are stored as calibration.csv beside the results.
"""

from __future__ import annotations

import csv
import io
import math
from pathlib import Path

from nsbench.gate.facts import Fact
from nsbench.source_files.regular_files import exists, read_text

NAME = "calibration.csv"
ENOUGH = 10 << 20  # bytes
COLUMNS = ("case", "solver", "parameters", "metric", "spread", "config")


def spreads(first: dict[tuple, Fact], others: list[dict[tuple, Fact]]) -> dict[tuple, float]:
    """The largest distance of each fact from those of the same key in other studies; inf where one
    of them lacks it, or says another word."""
    out = {}
    for key, fact in first.items():
        out[key] = max((_apart(fact, other.get(key)) for other in others), default=0.0)
    return out


def _apart(a: Fact, b: Fact | None) -> float:
    if b is None or isinstance(a.value, str) != isinstance(b.value, str):
        return math.inf
    if isinstance(a.value, str):
        return 0.0 if a.value == b.value else math.inf
    return abs(a.value - b.value) if math.isfinite(a.value) and math.isfinite(b.value) else math.inf


def text(found: dict[tuple, float], facts: dict[tuple, Fact]) -> str:
    """The file's text: each spread with the configuration of the fact that it was found for."""
    out = io.StringIO()
    w = csv.writer(out, lineterminator="\n")
    w.writerow(COLUMNS)
    w.writerows([*key, repr(v), facts[key].config] for key, v in found.items())
    return out.getvalue()


def read(folder, facts: dict[tuple, Fact] | None = None) -> dict[tuple, float]:
    """Spreads by key, of these facts: what was found for another case, solver or ladder of that
    name is none of theirs (None:
    all). FileNotFoundError where nothing was calibrated; ValueError names what cannot be read."""
    path = Path(folder) / NAME
    if not exists(path):
        raise FileNotFoundError(
            f"no {path}: tolerances come from how far numbers spread; run nsbench calibrate "
            f"{folder} first"
        )
    text = read_text(path, ENOUGH, path.parent)
    try:
        rows = list(csv.reader(io.StringIO(text, newline=""), strict=True))
    except csv.Error as e:
        raise ValueError(f"{path} cannot be read: {e}") from None
    if not rows or tuple(rows[0]) != COLUMNS:
        raise ValueError(
            f"{path}: the first line is not {','.join(COLUMNS)}; run nsbench calibrate {folder} "
            f"again"
        )
    out = {}
    all_of = facts is None
    for i, row in enumerate(rows[1:], 2):
        try:
            *key, value, config = row
            spread = float(value)
        except ValueError:
            raise ValueError(f"{path}, line {i}: {row!r} is no key with a spread") from None
        if len(key) != 4 or not spread >= 0:
            raise ValueError(f"{path}, line {i}: {row!r} is no key with a spread")
        if all_of or (tuple(key) in facts and facts[tuple(key)].config == config):
            out[tuple(key)] = spread
    return out
