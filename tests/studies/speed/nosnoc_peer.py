"""nosnoc (finite elements with switch detection and IPOPT) against the event-driven method at equal
error.

    python tests/studies/speed/nosnoc_peer.py                (needs pip install "nsbench[nosnoc]")

For each case nosnoc runs with the settings below, which were the quickest found that solve every
step: few long steps of high order. Errors, at those steps, are against the bench's reference, a
closed form or a certificate. Then event_driven runs at the loosest tolerance of a ladder whose
error is not larger. Both are prepared before; what that takes is printed. SciPy's solve_ivp with
modes written by hand, at the same rule, stands beside them.
"""

import argparse
import os
import platform
import time
from importlib.util import find_spec

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

import numpy as np  # noqa: E402

import nsbench  # noqa: E402
from nsbench import solvers  # noqa: E402
from nsbench.measure.clock import interleaved, ratio  # noqa: E402
from nsbench.measure.context import context_of  # noqa: E402

SETTINGS = (
    ("oscillator", 3, 4, 1e-10),
    ("oscillator", 2, 5, 1e-12),
    ("slide_exit", 15, 4, 1e-10),
    ("slide_exit", 6, 4, 1e-12),
    ("three_discs", 6, 3, 1e-10),
)  # case, samples per step, stages, comp_tol
TOLERANCES = 10.0 ** -np.arange(3.0, 14.0)


def error(traj, ref):
    return float(np.abs(traj.x - ref).max()) if traj.status.ok else float("inf")


def equal(case, spec, ref, wanted):
    """The run of `spec` at the loosest tolerance of the ladder with an error of at most `wanted`:
    run, tol, error."""
    for tol in TOLERANCES:
        run = solvers.get(spec).prepare(case, float(tol))
        found = error(run(), ref)
        if found <= wanted:
            return run, float(tol), found
    return run, float(tol), found


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--rounds", type=int, default=3)
    args = parser.parse_args()
    if not (find_spec("nosnoc") and find_spec("casadi")):
        print(
            'nosnoc is not installed; pip install "nsbench[nosnoc]" brings it and casadi. Nothing '
            "to compare."
        )
        return
    import casadi

    print(
        f"{platform.machine()}, load {os.getloadavg()[0]:.1f}, numpy {np.__version__}, casadi "
        f"{casadi.__version__}"
    )
    for name, stride, stages, comp_tol in SETTINGS:
        whole = nsbench.get_case(name)
        ref = context_of(whole).ref.x[::stride]
        case = whole.replace(t=whole.t[::stride])
        start = time.perf_counter()
        theirs = solvers.get(f"nosnoc[stages={stages},comp_tol={comp_tol:g}]").prepare(
            case, float(case.t[-1])
        )
        made = time.perf_counter() - start
        traj = theirs()
        got = error(traj, ref)
        if not traj.status.ok:
            print(f"{name}: nosnoc ended with {traj.status.code}: {traj.status}")
            continue
        ours, tol, mine = equal(case, "event_driven", ref, got)
        hand, hand_tol, hands = equal(case, "solve_ivp", ref, got)
        times = interleaved(
            {"nosnoc": theirs, "event_driven": ours, "solve_ivp": hand}, args.rounds
        )
        print(
            f"{name}, {len(case.t) - 1} steps of {stages} stages\n"
            f"  nosnoc        error {got:.1e}  {times['nosnoc'].median:9.3g} s   (prepared in "
            f"{made:.2g} s)\n"
            f"  event_driven  error {mine:.1e}  {times['event_driven'].median:9.3g} s   tol "
            f"{tol:.1e}: "
            f"nosnoc takes {ratio(times['nosnoc'], times['event_driven'])} times as long\n"
            f"  solve_ivp     error {hands:.1e}  {times['solve_ivp'].median:9.3g} s   tol "
            f"{hand_tol:.1e}: "
            f"nosnoc takes {ratio(times['nosnoc'], times['solve_ivp'])} times as long"
        )


if __name__ == "__main__":
    main()
