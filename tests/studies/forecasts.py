"""How far a forecast of seconds is off: for every case and solver of a study the runs of the finer
half of the ladder are foreseen from those of the coarser half, and whole pairs from the solver's
other cases.

    python tests/studies/forecasts.py [DIR]        (default: reports/sample)

Prints, by source, how many runs were foreseen, the quartiles of forecast over measured, the share
within a factor of two, and the ratio of the sums, which is what a plan adds up.
"""

import csv
import sys
from collections import defaultdict
from pathlib import Path

import numpy as np

from nsbench.execute.forecast import Forecast
from nsbench.study import Spec


def read(folder: Path) -> list[dict]:
    with open(folder / "runs.csv", newline="", encoding="utf-8") as file:
        rows = [r for r in csv.DictReader(file) if r.get("seconds")]
    return [
        r
        | {
            k: float(r.get(k) or 0.0)
            for k in ("asked", "seconds", "setup_seconds", "compile_seconds")
        }
        for r in rows
    ]


def tell(name: str, pairs: list[tuple[float, float]]) -> None:
    ahead, real = np.array(pairs).T
    ratio = ahead / real
    low, middle, high = np.percentile(ratio, (25, 50, 75))
    print(
        f"{name}: {len(pairs)} runs, forecast over measured {middle:.2f} [{low:.2f}, {high:.2f}], "
        f"worst {ratio.min():.2g} and "
        f"{ratio.max():.2g}, {np.mean(np.abs(np.log(ratio)) < np.log(2.0)):.0%} within a factor "
        f"of 2; sums {ahead.sum():.3g} s "
        f"and {real.sum():.3g} s, ratio {ahead.sum() / real.sum():.2f}"
    )


def alone(forecast: Forecast, row: dict) -> float:
    """Seconds of the run alone, as the column of that name."""
    return forecast.seconds(Spec(row["case"], row["solver"], row["accuracy"], row["asked"]))


def main(folder: Path) -> None:
    by_pair = defaultdict(list)
    for r in read(folder):
        by_pair[r["case"], r["solver"]].append(r)
    finer = []
    for rows in by_pair.values():
        rows.sort(key=lambda r: r["asked"], reverse=rows[0]["accuracy"] != "k")
        half = (len(rows) + 1) // 2
        if half >= 3:
            forecast = Forecast(rows[:half])
            finer += [(alone(forecast, r), r["seconds"]) for r in rows[half:]]
    tell("the finer half from the coarser", finer)
    elsewhere = []
    every = [r for rows in by_pair.values() for r in rows]
    for (case, _), rows in by_pair.items():
        if "[" not in case:
            forecast = Forecast(
                [r for r in every if r["case"] != case and r["solver"] == rows[0]["solver"]]
            )
            elsewhere += [(alone(forecast, r), r["seconds"]) for r in rows[::6]]
    tell("from the solver's other cases", elsewhere)


if __name__ == "__main__":
    main(
        Path(
            sys.argv[1]
            if len(sys.argv) > 1
            else Path(__file__).resolve().parents[2] / "reports" / "sample"
        )
    )
