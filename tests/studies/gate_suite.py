"""The small suite of the gate studies, run in one process and held against a baseline.

    python tests/studies/gate_suite.py RESULTS [-s METHOD ...] [--cases CASE ...] [--baseline FILE]
    python tests/studies/gate_suite.py RESULTS --reference

Every run once and without the clock, written as a folder of results without its report; of the long
cases the coarser steps alone. The exit status is that of `nsbench gate` where a baseline is given.
--reference stores a reference of the last case that knows little, so that the error of a reference
counts in some number. gate_faults.py starts this in a copy of the checkout, which may be broken.
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
    "duplicate",
    "slide_exit",
    "relay_lcs",
    "kinked_fields",
    "kinked_fields[torn=true]",
    "curved_floor",
    "curved_floor[height=5.0]",
)
METHODS = ("pbd", "catching_up", "event_driven", "euler[implicit=true]", "theta")
COARSE = 1e-6  # error that the reference of the last case is said to have
LONG = ("discs[n=30]", "curved_floor")  # cases of which the finer steps take most of the time
STEPS = 12  # of their ladders: four octaves; an order has a verdict from six on


def planned(cases, methods) -> list:
    """Return the specs of the suite."""
    from nsbench.study.plan import plan_runs

    ladders: dict[tuple, list] = {}
    for spec in plan_runs([(c, "") for c in cases], list(methods)):
        ladders.setdefault((spec.case, spec.solver), []).append(spec)
    out = []
    for (case, _), ladder in ladders.items():
        coarse_first = sorted(ladder, key=lambda s: -s.asked)
        out += coarse_first[:STEPS] if case in LONG else coarse_first
    return out


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


def store_coarse_reference() -> None:
    """Store a run of event_driven as a reference of the last case that is known to COARSE only."""
    from nsbench import get_case, solve
    from nsbench.reference.reference import Reference
    from nsbench.reference.storage import store

    case = get_case("curved_floor", height=5.0)
    run = solve(case, "event_driven")
    known = (run.t, run.x, run.contacts, run.impulse, run.reaction, run.events)
    bounds = (COARSE, COARSE, COARSE)
    store(case, Reference(*known, *bounds, kind="stored", how="one run", event_error=COARSE))


def main() -> int:
    p = argparse.ArgumentParser()
    p.add_argument("results", type=Path)
    p.add_argument("-s", dest="methods", action="append")
    p.add_argument("--cases", nargs="*", default=CASES)
    p.add_argument("--baseline", type=Path)
    p.add_argument("--reference", action="store_true")
    args = p.parse_args()
    if args.reference:
        store_coarse_reference()
        return 0
    write(args.results, planned(args.cases, args.methods or METHODS))
    if not args.baseline:
        return 0
    from nsbench.cli.main import main as nsbench

    return nsbench(["gate", str(args.results), "--baseline", str(args.baseline)])


if __name__ == "__main__":
    sys.exit(main())
