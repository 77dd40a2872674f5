"""Every system of tests/independent at default settings against its truth, one process each.

    python tests/studies/independent.py [NAME ...] [--solver event_driven] [--limit 300]

One line per system: status, largest errors of states, impulses and event times relative to max(1,
size), seconds.
The truths are by an integrator of their own (extrapolated midpoint rule at 45 digits), written
without using the bench.
Exit status 1 if a status is not ok, an error is above its bound, or an event is missed or extra.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from dataclasses import asdict
from pathlib import Path

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
sys.path.insert(0, str(Path(__file__).parents[1] / "independent"))

import truths  # noqa: E402

import nsbench  # noqa: E402

BOUNDS = {"state": 1e-10, "impulse": 1e-9, "event": 1e-9}


def solved(name: str, solver: str) -> dict:
    """One run, as a row."""
    start = time.perf_counter()
    traj = nsbench.solve(truths.case(name), solver)
    seconds = time.perf_counter() - start
    row = {"status": traj.status.code, "why": str(traj.status), "seconds": seconds}
    return {**row, **asdict(truths.compare(traj, truths.truth(name)))} if traj.status.ok else row


def in_process(name: str, solver: str, limit: float) -> dict:
    """The row of one run in a process of its own, which is ended after `limit` seconds."""
    try:
        out = subprocess.run(
            [sys.executable, __file__, name, "--solver", solver, "--row"],
            capture_output=True,
            text=True,
            timeout=limit,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return {"status": "timeout", "why": f"not done after {limit:g} s"}
    if out.returncode:
        return {"status": "crashed", "why": (out.stderr.strip().splitlines() or ["no message"])[-1]}
    return json.loads(out.stdout.splitlines()[-1])


def faults(row: dict) -> str:
    """What is wrong with a row, in words; empty if nothing."""
    if row["status"] != "ok":
        return row["why"]
    above = [f"{key} above {bound:g}" for key, bound in BOUNDS.items() if not row[key] <= bound]
    events = [
        f"{len(row[key])} {key}, the first at {row[key][0]:.8g}"
        for key in ("missed", "extra")
        if row[key]
    ]
    return "; ".join(above + events)


def line(name: str, row: dict) -> str:
    figures = "".join(f"{row[key]:9.1e}" if key in row else f"{'-':>9s}" for key in BOUNDS)
    return (
        f"{name:18s} {row['status']:10s}{figures} {row.get('seconds', float('nan')):8.2f} "
        f"{faults(row)}"
    ).rstrip()


def main(argv=None) -> int:
    """Number of systems that fail."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help="all of them unless given")
    parser.add_argument("--solver", default="event_driven")
    parser.add_argument("--limit", type=float, default=300.0, help="seconds for one system")
    parser.add_argument("--row", action="store_true", help=argparse.SUPPRESS)
    o = parser.parse_args(argv)
    if unknown := sorted(set(o.names) - set(truths.names())):
        parser.error(f"no system {', '.join(unknown)}; there are {', '.join(truths.names())}")
    if o.row:
        print(json.dumps(solved(o.names[0], o.solver)))
        return 0
    print(
        f"{'system':18s} {'status':10s}"
        + "".join(f"{key:>9s}" for key in BOUNDS)
        + f" {'seconds':>8s}"
    )
    rows = {}
    for name in o.names or truths.names():
        rows[name] = in_process(name, o.solver, o.limit)
        print(line(name, rows[name]), flush=True)
    bad = [name for name, row in rows.items() if faults(row)]
    worst = ", ".join(
        "{} {:.1e} ({})".format(key, *max((row.get(key, 0.0), name) for name, row in rows.items()))
        for key in BOUNDS
    )
    print(
        f"{len(rows) - len(bad)} of {len(rows)} good; worst {worst}"
        + (f"; not good: {', '.join(bad)}" if bad else "")
    )
    return len(bad)


if __name__ == "__main__":
    sys.exit(1 if main() else 0)
