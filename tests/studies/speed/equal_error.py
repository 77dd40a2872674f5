"""The cheapest method at equal error, for 3 to 1000 discs: who wins at 1e-2, 1e-3, 1e-4 and 1e-6,
and by which factor.

    python tests/studies/speed/equal_error.py                       (--sizes 3,10,30,100,1000
    --budget 16 -s SOLVER ...)

Scenes: discs[n=N], seed 0, drawn together and turned, to T = 3 (21 samples; the references stored
with the bench). For N = 1000 the same scene to T = 0.25 (3 samples, 631 events), whose reference is
made here: the event-driven method at its tightest tolerance, its bound the change from a looser
one. --reference richardson is an independent one: the extrapolation of PBD at its two finest steps,
with the change from one level coarser. Errors below ten times a bound are not numbers.

Every method runs at finer and finer steps (ratio 2), tolerances (ratio 100) or stiffnesses (ratio
4) until its error is below 1e-6 or its share of the seconds per size (--budget) is spent; then all
runs of a size are timed in interleaved rounds.
Seconds of an error come from the work-precision curve as in the report (nsbench.report.cost),
preparation and compilation apart. Compiled loops are ranked; a loop in Python stands below them, as
its seconds measure an interpreter.
"""

import argparse
import os
import platform
import time

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

import numpy as np  # noqa: E402

import nsbench  # noqa: E402
from nsbench import solvers  # noqa: E402
from nsbench.measure import clock  # noqa: E402
from nsbench.report import cost as speed  # noqa: E402
from nsbench.report import data as source  # noqa: E402
from nsbench.report.style import (  # noqa: E402
    LEADING_METHOD,
    format_factor,
    format_power,
    format_seconds,
    method_of,
)
from nsbench.results.environment import versions  # noqa: E402

EXTRA = (
    "pbd[order=reverse]",
    "pbd[order=cell]",
    "pbd[order=coloured]",
    "richardson[method=catching_up]",
)
OUT = ("nosnoc", "solve_ivp")  # modes by hand: other cases; nosnoc: minutes
# discs beyond which the run ends at SHORT
LARGE = 300
SHORT = 0.25
DEEP = 15  # halvings of the sample spacing in the reference of a large scene


def methods(asked):
    """Specs to try: those asked for, or the standard ones with the other orders of PBD, as far as
    they exist."""
    out = []
    for spec in asked or (*solvers.standard(), *EXTRA):
        try:
            solvers.get(spec)
        except (LookupError, ValueError):
            continue
        if asked or method_of(spec) not in OUT:
            out.append(spec)
    return list(dict.fromkeys(out))


def scene(n: int, how: str):
    """The case, its reference states (None: the stored one is used) and the bound of the state
    error."""
    case = nsbench.get_case("discs", n=n)
    if n < LARGE:
        from nsbench.reference import reference

        return case, None, reference(case).state_error
    case = case.replace(t=np.linspace(0.0, SHORT, 4))
    if how == "event_driven":
        traj = nsbench.solve(case, "event_driven")
        looser = nsbench.solve(case, "event_driven", tol=1e-10)
        if not traj.status.ok:
            raise SystemExit(f"event_driven on {n} discs: {traj.status}")
        return case, traj.x, float(np.abs(traj.x - looser.x).max())
    spacing = case.t[1]
    x = [
        nsbench.solve(case, LEADING_METHOD, h=spacing / 2**k).x for k in (DEEP - 2, DEEP - 1, DEEP)
    ]
    fine = 2 * x[2] - x[1]
    coarse = 2 * x[1] - x[0]
    return case, fine, float(np.abs(fine - coarse).max())


def accuracies(case, method):
    """Ever finer ones, without end."""
    if method.accuracy == "h":
        k = 0
        while True:
            yield float(np.diff(case.t).min()) / 2**k
            k += 1
    a, ratio = (1e-3, 1e-2) if method.accuracy == "tol" else (30.0, 4.0)
    while a > 1e-13:
        yield a
        a *= ratio


def ladder(case, spec, reference, bound, budget):
    """(row, run) of every accuracy tried."""
    method = solvers.get(spec)
    out = []
    spent = 0.0
    if method.refuses(case):
        return out
    for accuracy in accuracies(case, method):
        try:
            run, _ = clock.prepared(lambda: method.prepare(case, accuracy))  # noqa: B023
            start = time.process_time()  # a budget that other work on the machine does not eat
            traj = run()
            took = time.process_time() - start
        except (ValueError, MemoryError):
            break
        spent += took
        if traj.status.code in ("ok", "unverified", "degenerate") and len(traj.t) == len(case.t):
            error = (
                float(np.abs(traj.x - reference).max())
                if reference is not None
                else nsbench.errors(case, traj)["state_sup"]
            )
            row = {
                "case": case.key,
                "solver": spec,
                "accuracy": method.accuracy,
                "asked": accuracy,
                "status": "ok",
                "h": 1.0 / accuracy if method.accuracy == "k" else accuracy,
                "seconds": took,
                "rounds": 1,
                "loop": traj.stats.get("loop", ""),
                "state_sup": max(error, 1e-300),
            }
            out.append((row, run))
            if error < 1e-6:
                break
        if spent + (2.2 if method.accuracy == "h" else 1.0) * took > budget:
            break
    return out


def measured(case, specs, reference, bound, budget):
    """Rows of all methods on one scene, timed in interleaved rounds."""
    found = [
        pair for spec in specs for pair in ladder(case, spec, reference, bound, budget / len(specs))
    ]
    rounds = [clock.rounds_of(row["seconds"]) for row, _ in found]
    times = clock.in_rounds([run for _, run in found], rounds, lambda i: None)
    return [row | clock.columns(t) for (row, _), t in zip(found, times, strict=True)]


def told(data, key, target, bound):
    """The line of one size and one error."""
    if target < 10 * bound:
        return "the reference cannot tell"
    found = speed.rank_costs(data, key, target)
    ranked = [c for c in found if c.loop == "compiled"]
    if not ranked:
        more = _beyond(data, key, target)
        return "not reached by a compiled loop within its share of the budget" + (
            f"; {LEADING_METHOD} would need about {format_seconds(more)}, going on with order 1"
            if more == more
            else ""
        )
    first = ranked[0]
    pbd = next((c for c in ranked if method_of(c.solver) == LEADING_METHOD), None)
    text = (
        f"{first.solver} {'<= ' if first.at_most else ''}{format_seconds(first.seconds)} "
        f"({speed.format_setting(first)})"
    )
    rivals = [c for c in ranked if method_of(c.solver) != method_of(first.solver)]
    if rivals:
        text += (
            f"; next other method x {format_factor(rivals[0].seconds / first.seconds)} "
            f"({rivals[0].solver})"
        )
    if pbd is None:
        more = _beyond(data, key, target) / first.seconds
        text += (
            f"; {LEADING_METHOD} would need about x {format_factor(more)}, going on with order 1"
            if more == more
            else f"; {LEADING_METHOD} is not yet converging at the steps that its share of the "
            "budget allows"
        )
    elif pbd is not first:
        text += f"; {LEADING_METHOD} x {format_factor(pbd.seconds / first.seconds)} ({pbd.solver})"
    hosts = [
        f"{c.solver} x {format_factor(c.seconds / first.seconds)}"
        for c in found
        if c.loop != "compiled"
    ]
    return text + (f"   [loops in Python: {', '.join(hosts[:3])}]" if hosts else "")


def _beyond(data, key, target):
    """Seconds of the best PBD at an error it was not run to: the cost of its finest run times what
    the error must lose.
    NaN where its last two halvings of the step did not halve the error (1.6 to 2.5)."""
    own = [r.col for r in data.of_case(key) if method_of(r.solver) == LEADING_METHOD and len(r) > 2]
    own = [
        c
        for c in own
        if all(
            1.6 < a / b < 2.5
            for a, b in zip(c["state_sup"][-3:-1], c["state_sup"][-2:], strict=True)
        )
    ]
    return min((c["seconds"][-1] * c["state_sup"][-1] / target for c in own), default=float("nan"))


def main():
    p = argparse.ArgumentParser()
    p.add_argument("--sizes", default="3,10,30,100,1000")
    p.add_argument(
        "--budget",
        type=float,
        help="seconds of runs per size, shared by the methods (16, for 100 discs 70)",
    )
    p.add_argument(
        "--reference",
        choices=("richardson", "event_driven"),
        default="event_driven",
        help="of the large scene",
    )
    p.add_argument("-s", "--solver", action="append")
    args = p.parse_args()
    specs = methods(args.solver)
    wins = []
    print(
        f"Python {platform.python_version()}, numpy {versions()['numpy']}, numba "
        f"{versions()['numba']}; load average "
        f"{os.getloadavg()[0]:.1f} of {os.cpu_count()} cores\nmethods: "
        f"{', '.join(specs)}\n{speed.COMPARISON_RULE}\n"
    )
    for n in map(int, args.sizes.split(",")):
        case, reference, bound = scene(n, args.reference)
        data = source.read(
            measured(
                case, specs, reference, bound, args.budget or (70.0 if 30 < n < LARGE else 16.0)
            )
        )
        print(f"{n} discs to T = {case.t[-1]:g}; the reference is known to {bound:.1e}")
        for target in speed.TARGETS:
            line = told(data, case.key, target, bound)
            print(f"  error {format_power(target)}  {line}", flush=True)
            wins += [(n, target)] if line.startswith(LEADING_METHOD) else []
    print(
        f"\n{LEADING_METHOD} is the cheapest at "
        + (", ".join(f"N = {n}, {format_power(t)}" for n, t in wins) or "no size and error")
        + "; nowhere else."
    )


if __name__ == "__main__":
    main()
