"""Are the errors kept that `nsbench step` promises, and the tolerances of methods that have one?

    python tests/studies/promised_errors.py [--own 10] [--error 1%] [--tolerances]

Ten scenes of the catalogue, and --own drawn ones (tests/studies/effectivity.py). Of each, and of
PBD and catching-up, one line: the step that is chosen, how the error is known, promised and true
error in the 2-norm over the samples (against the reference; of a drawn scene event_driven), seconds
of the choice. At the end how many promises were kept; exit status 1 if one was not.
--tolerances: the method is run with the error as its tolerance instead; stated are the true error
over it, the error bar over the true error, the steps of all passes, and over them those of the
longest equal steps whose true error, which only the reference tells, is as small as the tolerance.
"""

import argparse
import sys
import time
import warnings

import numpy as np
from effectivity import SEED, discs_scene, truth, walls_scene

import nsbench
from nsbench.case import get_case
from nsbench.study.step_choice import choose, demand_of

CATALOGUE = ("tide", "rods[n=5]", "wedge", "box_turning", "discs[n=3]", "discs[n=10]", "hex")
CATALOGUE = (*CATALOGUE, "chain", "obstacle", "epithelium[n=6]")
METHODS = ("pbd", "catching_up")
ROUNDING = 1e-12  # of the size of the state


def judged(case, method, demand):
    """Return the choice, its seconds, and the true error of a run with it; None: no choice."""
    start = time.perf_counter()
    choice = choose(case, method, demand)
    seconds = time.perf_counter() - start
    if not choice.is_found:
        return choice, seconds, None
    run = nsbench.solve(case, method, **{choice.name: choice.accuracy})
    return choice, seconds, true_error(case, run)


def true_error(case, run):
    """Return the largest error over the samples, the doubt about it taken off."""
    x, _, doubt = truth(case)
    return max(0.0, float(np.linalg.norm(run.x - x, axis=1).max()) - doubt)


def fewest_steps(case, method, tolerance):
    """Return how many steps the run with the longest equal steps takes that keeps the tolerance, to
    five per cent, by bisection; a sample interval has a whole number of steps."""
    span = float(case.t[-1] - case.t[0])
    few = 0
    enough = len(case.t) - 1
    while not (run := _equal_steps(case, method, span / enough, tolerance)):
        few = enough
        enough *= 2
    while few and enough - few > 0.05 * enough + 1:
        middle = (few + enough) // 2
        found = _equal_steps(case, method, span / middle, tolerance)
        few, enough = (few, middle) if found else (middle, enough)
        run = found or run
    return run.stats["steps"]


def _equal_steps(case, method, h, tolerance):
    """Return the run with equal steps if it keeps the tolerance, else None."""
    run = nsbench.solve(case, method, h=h)
    return run if true_error(case, run) <= tolerance else None


def tolerance_kept(case, method, demand):
    """Print how a run with a tolerance ends; return its error over the tolerance, its steps over
    the fewest equal ones, and its error bar over the error. None: it says that it did not reach it.
    """
    run = nsbench.solve(case, f"{method}[tol={demand.error:.17g}]")
    name = f"{case.key} {method}"
    if not run.status.ok:
        print(f"{name:36} {run.status.code}: {run.status.why}", flush=True)
        return None
    error = true_error(case, run)
    share = error / demand.error
    near = float(run.bound.state.max()) / error if share > ROUNDING else np.nan
    fewest = fewest_steps(case, method, demand.error)
    steps = run.stats["steps"]
    kind = "proven" if run.bound.is_proven else "estimate"
    print(
        f"{name:36} {kind:8} error {share:.3g} of the tolerance {demand.error:.3g}, bar {near:.3g} "
        f"of it, {steps} steps in {run.stats['passes']} passes, "
        f"{steps / fewest:.2f} times {fewest}",
        flush=True,
    )
    return share, steps / fewest, near


def tolerances(cases, error):
    """Print a line a run with a tolerance; exit status 1 if one was not kept."""
    found = []
    for case in cases:
        if truth(case) is None:
            continue
        found += [tolerance_kept(case, m, demand_of(case, error)) for m in METHODS]
    share, work, near = np.array([f for f in found if f]).T
    print(
        f"{len(share)} of {len(found)} reached; {(share > 1.0).sum()} above the tolerance; "
        f"{(share >= 0.1).sum()} within a tenth of it; {(work <= 2.0).sum()} with at most twice "
        f"the steps, median {np.median(work):.2f}, most {work.max():.2f}; error bars "
        f"{np.nanmin(near):.3f} to {np.nanmax(near):.3f} of the error"
    )
    return int((share > 1.0).any())


def main():
    """Print a line a choice; exit status 1 if a promise was not kept."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--own", type=int, default=10, metavar="N")
    parser.add_argument("--error", default="1%")
    parser.add_argument("--tolerances", action="store_true")
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    own = [(walls_scene, discs_scene)[k % 2](SEED + 1000 + k) for k in range(args.own)]
    cases = [*map(get_case, CATALOGUE), *own]
    if args.tolerances:
        return tolerances(cases, args.error)
    kept = []
    broken = []
    unmet = []
    for case in cases:
        if truth(case) is None:
            print(f"{case.key:24} has no truth", flush=True)
            continue
        demand = demand_of(case, args.error)
        for method in METHODS:
            name = f"{case.key} {method}"
            choice, seconds, error = judged(case, method, demand)
            if error is None:
                unmet.append(name)
                print(f"{name:36} {choice.why} {seconds:.2f} s", flush=True)
                continue
            size = max(1.0, float(np.abs(case.x0).max()))
            (kept if error <= choice.error + ROUNDING * size else broken).append(name)
            print(
                f"{name:36} h = {choice.accuracy:.3g} {choice.sure:12} promised "
                f"{choice.error:.3g} of {demand.error:.3g}, true {error:.3g}, {seconds:.2f} s",
                flush=True,
            )
    print(f"{len(kept)} kept, {len(broken)} not kept: {broken}, {len(unmet)} not met: {unmet}")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
