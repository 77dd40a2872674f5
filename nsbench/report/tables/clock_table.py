"""Tabulate the clock of a study by method: compilation, set-up and run apart, and their spread."""

from __future__ import annotations

import numpy as np

from nsbench.measure.clock import LONG
from nsbench.report.data import Data
from nsbench.report.style import TIMES, format_factor, format_seconds
from nsbench.report.tables.cells import Cell, Row, Table

CLOCK_COLUMNS = (
    "compile_seconds",
    "setup_seconds",
    "seconds",
    "rounds",
    "seconds_low",
    "seconds_high",
    "seconds_max",
)


def clock_table(data: Data) -> Table:
    """Build the table of the clock, one row for each method.

    Seconds: of compilation in all, of one set-up (median), of the runs in all; then the quartiles
    over rounds and the worst round, each over the median.
    """
    rows = []
    for solver in data.specs:
        runs = [
            r
            for (_, s), r in data.runs.items()
            if s == solver and np.isfinite(r.col["seconds"]).any()
        ]
        if not runs:
            continue
        col = {name: np.concatenate([r.col[name] for r in runs]) for name in CLOCK_COLUMNS}
        timed = col["rounds"] > 1
        rows.append(
            Row(
                (
                    Cell(solver, kind="method"),
                    Cell(_total(col["compile_seconds"])),
                    Cell(_median(col["setup_seconds"])),
                    Cell(_total(col["seconds"])),
                    Cell(f"{int(timed.sum())} of {int(np.isfinite(col['seconds']).sum())}"),
                    Cell(_spread(col, timed)),
                    Cell(_worst(col, timed)),
                ),
                solver=solver,
            )
        )
    return Table(
        "clock",
        (
            "method",
            "compilation, all cases",
            "set-up, median",
            "runs, all cases",
            "timed in rounds",
            "quartiles over median",
            "worst round over median",
        ),
        tuple(rows),
        "Compilation is what the first preparation in a process takes beyond a second one: "
        "compiling, loading from caches, imports; set-up is what each preparation takes; neither "
        f"is part of the seconds compared. Runs of {LONG:g} s and more (in rows of older versions, "
        "of 0.02 s) are timed once; the others in 3 to 7 rounds with the methods interleaved, the "
        "first call left out. The spread is the median over all timed runs, the worst round the "
        "largest factor seen."
        + describe_shared_runs(data),
    )


def describe_shared_runs(data: Data) -> str:
    """Write how many runs have no seconds because their workers were shared; "" if none."""
    count = sum(int((r.col["shared"] == 1.0).sum()) for r in data.runs.values())
    return (
        f" {count} runs were made by shared workers of a cluster: their seconds are stored, and "
        "used nowhere."
        if count
        else ""
    )


def _total(values) -> str:
    known = values[np.isfinite(values)]
    return format_seconds(float(known.sum())) if known.size else "not told"


def _median(values) -> str:
    known = values[np.isfinite(values)]
    return format_seconds(float(np.median(known))) if known.size else "not told"


def _spread(col, timed) -> str:
    use = timed & np.isfinite(col["seconds_low"]) & (col["seconds"] > 0)
    if not use.any():
        return "no rounds"
    low, high = (
        float(np.median(col[n][use] / col["seconds"][use])) for n in ("seconds_low", "seconds_high")
    )
    return f"{low:.2f} to {high:.2f}"


def _worst(col, timed) -> str:
    use = timed & np.isfinite(col["seconds_max"]) & (col["seconds"] > 0)
    return (
        f"{TIMES} {format_factor(float((col['seconds_max'][use] / col['seconds'][use]).max()))}"
        if use.any()
        else "no rounds"
    )
