"""Write the error bar of each run beside its error, both in the 2-norm, for tooltips and tables."""

from __future__ import annotations

import numpy as np

from nsbench.report.data import Runs
from nsbench.report.style import format_number

KINDS = ("bound", "estimate")
QUANTITIES = {"state_sup": "state", "reaction": "reaction"}  # of the charted columns with bars


def describe_bars(runs: Runs, column: str) -> list[str]:
    """Describe the error bars of a charted column: ``error bar (bound) 0.012, error 0.0098``.

    column: state_sup or reaction; errors of others have no bars. Returns a text for each run, ""
    for a run without a bar.
    """
    quantity = QUANTITIES.get(column)
    if quantity is None:
        return [""] * len(runs)
    error = runs.col[f"{quantity}_norm"]
    bars = {kind: runs.col[f"{kind}_{quantity}"] for kind in KINDS}
    return [_describe(bars, error, k) for k in range(len(runs))]


def _describe(bars: dict[str, np.ndarray], error: np.ndarray, k: int) -> str:
    """Describe the bar of run k; a bound goes before an estimate."""
    kind = next((kind for kind in KINDS if np.isfinite(bars[kind][k])), "")
    if not kind:
        return ""
    true = format_number(float(error[k])) if np.isfinite(error[k]) else "not known"
    return f"error bar ({kind}) {format_number(float(bars[kind][k]))}, error {true}"
