"""Are the errors kept that `nsbench step` promises?

    python tests/studies/promised_errors.py [--own 10] [--error 1%]

Ten scenes of the catalogue, and --own drawn ones (tests/studies/effectivity.py). Of each, and of
PBD and catching-up, one line: the step that is chosen, how the error is known, promised and true
error in the 2-norm over the samples (against the reference; of a drawn scene event_driven), seconds
of the choice. At the end how many promises were kept; exit status 1 if one was not.
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
    x, _, doubt = truth(case)
    run = nsbench.solve(case, method, **{choice.name: choice.accuracy})
    error = float(np.linalg.norm(run.x - x, axis=1).max())
    return choice, seconds, max(0.0, error - doubt)


def main():
    """Print a line a choice; exit status 1 if a promise was not kept."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--own", type=int, default=10, metavar="N")
    parser.add_argument("--error", default="1%")
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    own = [(walls_scene, discs_scene)[k % 2](SEED + 1000 + k) for k in range(args.own)]
    kept = []
    broken = []
    unmet = []
    for case in [*map(get_case, CATALOGUE), *own]:
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
