"""Error bars of runs beside their errors, both in the 2-norm: as numbers, and in words."""

from __future__ import annotations

import numpy as np

from nsbench.report.data import Runs
from nsbench.report.style import format_number

KINDS = ("bound", "estimate")
EXACT = 1e-9  # of the size of the quantity: a smaller error is none that a method makes
QUANTITIES = {"state_sup": "state", "reaction": "reaction"}  # of the charted columns with bars


def error_bars(runs: Runs, column: str) -> list[tuple[str, float, float] | None]:
    """Return kind, error bar and error of each run, of a charted column; None: no error bar.

    column: state_sup or reaction; errors of others have no bars. A bound goes before an estimate.
    The error is NaN where it is not known.
    """
    quantity = QUANTITIES.get(column)
    if quantity is None:
        return [None] * len(runs)
    error = runs.col[f"{quantity}_norm"]
    bars = {kind: runs.col[f"{kind}_{quantity}"] for kind in KINDS}
    found = []
    for k in range(len(runs)):
        kind = next((kind for kind in KINDS if np.isfinite(bars[kind][k])), "")
        found.append((kind, float(bars[kind][k]), float(error[k])) if kind else None)
    return found


def measurable(runs: Runs, quantity: str) -> np.ndarray:
    """Mark the runs (len(runs),) whose error in the 2-norm can be told from rounding and from the
    error of the reference; quantity: state or reaction."""
    name = f"{quantity}_norm"
    error = runs.col[name]
    with np.errstate(all="ignore"):
        return runs.good & (error > EXACT * runs.scale(name)) & (error > runs.floor(name))


def describe_bars(runs: Runs, column: str) -> list[str]:
    """Describe the error bars of a charted column: ``error bar (bound) 0.012, error 0.0098``.

    Returns a text for each run, "" for a run without a bar.
    """
    return [_describe(*one) if one else "" for one in error_bars(runs, column)]


def _describe(kind: str, bar: float, error: float) -> str:
    true = format_number(error) if np.isfinite(error) else "not known"
    return f"error bar ({kind}) {format_number(bar)}, error {true}"
