"""The small suite of the gate studies, run in one process and held against a baseline.

    python tests/studies/gate_suite.py RESULTS [-s METHOD ...] [--cases CASE ...] [--baseline FILE]

The coarser part of every ladder, each run once and without the clock, written as a folder of
results without its report. The exit status is that of `nsbench gate` where a baseline is given.
gate_faults.py starts it in copies of the checkout, one of which may be broken.
"""

import argparse
import json
import sys
from pathlib import Path

CASES = (
    "tide",
    "three_discs",
    "discs[n=30]",
    "two_discs[w=1]",
    "hex",
    "slide_exit",
    "relay_lcs",
    "curved_floor",
)
METHODS = ("pbd", "catching_up", "event_driven", "euler[implicit=true]", "theta")
STEPS = 12  # of each ladder: four octaves; the finer steps take most of the time


def planned(cases, methods) -> list:
    """Return the specs of the suite."""
    from nsbench.study.plan import plan_runs

    ladders: dict[tuple, list] = {}
    for spec in plan_runs([(c, "") for c in cases], list(methods)):
        ladders.setdefault((spec.case, spec.solver), []).append(spec)
    return [
        spec
        for ladder in ladders.values()
        for spec in sorted(ladder, key=lambda s: -s.asked)[: STEPS if ladder[0].asked else None]
    ]


def write(folder: Path, specs: list) -> None:
    """Run the specs and write a folder of results that the gate can read."""
    from nsbench.results.tables import write_tables
    from nsbench.study import describe
    from nsbench.study.attempt import attempt
    from nsbench.study.plan import resolve

    rows = [attempt(spec)[0] for spec in specs]
    folder.mkdir(parents=True, exist_ok=True)
    write_tables(folder, rows)
    notes = {
        "cases": {s.case: describe.describe_case(resolve(s.case)) for s in specs},
        "solvers": {s.solver: describe.describe_solver(s.solver) for s in specs},
        "env": {},
        "extra": {},
    }
    for name, value in notes.items():
        (folder / f"{name}.json").write_text(json.dumps(value, default=str))


def main() -> int:
    p = argparse.ArgumentParser()
    p.add_argument("results", type=Path)
    p.add_argument("-s", dest="methods", action="append")
    p.add_argument("--cases", nargs="*", default=CASES)
    p.add_argument("--baseline", type=Path)
    args = p.parse_args()
    write(args.results, planned(args.cases, args.methods or METHODS))
    if not args.baseline:
        return 0
    from nsbench.cli.main import main as nsbench

    return nsbench(["gate", str(args.results), "--baseline", str(args.baseline)])


if __name__ == "__main__":
    sys.exit(main())
