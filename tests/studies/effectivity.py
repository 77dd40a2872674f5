"""Effectivity of error bars: over the true errors, for PBD and catching-up, cases and steps.

    python tests/studies/effectivity.py [CASE ...] [--steps 3]

One line for each case and method: whether its error bars are a bound or an estimate, the range of
the effectivity of state and reaction over the steps (largest error bar over the largest error, both
over the samples), and the least ratio of error bar and error at any sample whose error is above ten
times the bound of the reference. Then how many bounds were below an error at some sample, and how
many estimates had an effectivity outside 1 to 10, by name.
"""

import argparse
import sys
import warnings

import numpy as np

import nsbench
from nsbench.case import get_case
from nsbench.reference import reference
from nsbench.solvers import get

BOUNDS = ("rods[n=5]", "rods[n=10]", "rods_wall", "wedge", "wedge[psi=120]", "box_turning")
BOUNDS = (*BOUNDS, "box_turning[side=0.8]", "tide", "duplicate", "play", "moving_floor")
ESTIMATES = ("discs[n=3]", "discs[n=10]", "discs[n=30]", "hex", "stack", "chain", "obstacle")
ESTIMATES = (*ESTIMATES, "bean", "epithelium", "three_discs", "two_discs", "kissing", "wheel")
METHODS = ("pbd", "catching_up")
EXACT = 1e-9  # of the size of the state: errors below are none that a method makes


def measured(case, method, h):
    """Effectivity of state and reaction, least ratio at a sample, and is it a bound?"""
    traj = nsbench.solve(case, method, h=h)
    ref = reference(case)
    if traj.status.code not in ("ok", "unverified", "degenerate") or ref is None:
        return None
    error = np.linalg.norm(traj.x - ref.x, axis=1)
    size = max(1.0, float(np.abs(ref.x).max()))
    if error.max() <= max(EXACT * size, 10.0 * ref.state_error):
        return None
    seen = error > 10.0 * ref.state_error + EXACT * size
    least = float((traj.bound.state[seen] / error[seen]).min())
    state = float(traj.bound.state.max() / error.max())
    reaction = np.nan
    if ref.reaction is not None:
        off = np.linalg.norm(traj.reaction - ref.reaction, axis=1)
        reaction = float(traj.bound.reaction.max() / off.max())
    return state, reaction, least, traj.bound.is_proven


def main():
    """Print the effectivities; exit status 1 if a bound was below an error."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("cases", nargs="*", default=[*BOUNDS, *ESTIMATES])
    parser.add_argument("--steps", type=int, default=3)
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    below = []
    outside = []
    pairs = 0
    for name in args.cases:
        case = get_case(name)
        first = float(np.diff(case.t).min())
        for method in METHODS:
            if get(method).refuses(case):
                continue
            steps = [first / 2.7**k for k in range(args.steps)]
            found = [m for h in steps if (m := measured(case, method, h))]
            if not found:
                print(f"{name:24} {method:12} no error to compare with", flush=True)
                continue
            pairs += len(found)
            state, reaction, least, proven = (np.array(v) for v in zip(*found, strict=True))
            print(
                f"{name:24} {method:12} {'bound' if proven.all() else 'estimate':9}"
                f"state {state.min():.3g} .. {state.max():.3g}  reaction {np.nanmin(reaction):.3g}"
                f" .. {np.nanmax(reaction):.3g}  least {least.min():.4g}",
                flush=True,
            )
            for a, b, is_bound in zip(least, state, proven, strict=True):
                below += [name] if is_bound and a < 1.0 else []
                outside += [name] if not is_bound and not 1.0 <= b <= 10.0 else []
    print(f"{pairs} runs; bounds below an error: {below or 0}")
    print(f"estimates outside 1 to 10: {outside or 0}")
    return int(bool(below))


if __name__ == "__main__":
    sys.exit(main())
