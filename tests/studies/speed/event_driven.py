"""How fast the event-driven method follows contacts: against SciPy with modes written by hand, and
the plain method.

    python tests/studies/speed/event_driven.py [--rounds 5] [--most 100]

Ratios within interleaved rounds, compilation apart and stated first. "by hand": three_discs with
DOP853, a terminal event for every gap and load of a mode, and the order of the modes known to its
author. "plain": tests/plain_event_driven.
Errors are against a run at tol 1e-13.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from pathlib import Path

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

import numpy as np  # noqa: E402

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "support"))
from plain_event_driven import Plain  # noqa: E402
from plain_event_driven import run as plain  # noqa: E402

from nsbench import get_case  # noqa: E402
from nsbench.measure.clock import interleaved, ratio  # noqa: E402
from nsbench.solvers import get  # noqa: E402


def by_hand(case, rtol):
    """three_discs with its modes: held sets in the order in which contacts come, in
    scipy.integrate.solve_ivp."""
    from scipy.integrate import solve_ivp

    s = Plain(case)
    t = 0.0
    x = case.x0
    out = np.empty((len(case.t), case.n))
    for held in _modes(case):

        def gap(t, y, held=held):
            g = s.gaps(y)
            return min([g[k] for k in range(3) if k not in held], default=1.0)

        gap.terminal = True
        gap.direction = -1
        part = solve_ivp(
            lambda t, y, held=held: s.held(t, y, np.array(held, int))[0],
            (t, case.t[-1]),
            x,
            "DOP853",
            rtol=rtol,
            atol=rtol,
            events=gap,
            dense_output=True,
        )
        inside = (case.t >= t) & (case.t <= part.t[-1])
        out[inside] = part.sol(case.t[inside]).T
        t = part.t[-1]
        x = s.project(part.y[:, -1], np.array(held, int))
        if part.status == 0:
            return out
    return out


def _modes(case):
    """The held sets in order, as their author would know them: taken once from a run."""
    held = set()
    sets = [()]
    seen = {(0, 0, 1): 0, (0, 0, 2): 1, (0, 1, 2): 2}
    for e in _once(case).events:
        held = held | {seen[e.contact]} if e.kind == "contact" else held - {seen[e.contact]}
        sets.append(tuple(sorted(held)))
    return sets


_runs: dict = {}


def _once(case):
    if case.name not in _runs:
        _runs[case.name] = get("event_driven").prepare(case, 1e-12)()
    return _runs[case.name]


def compare(label, case, tol, other, rounds):
    """One line: our seconds, theirs, the ratio with quartiles, both errors."""
    run = get("event_driven").prepare(case, tol)
    truth = get("event_driven").prepare(case, 1e-13)().x
    mine = run()
    theirs = other()
    made = interleaved({"nsbench": run, "other": other}, rounds=rounds)
    r = ratio(made["other"], made["nsbench"])
    off = [np.abs(x - truth).max() for x in (mine.x, theirs)]
    print(
        f"{label:34s} {made['nsbench'].median * 1e3:9.2f} ms {made['other'].median * 1e3:10.1f} "
        f"ms   x{r}"
        f"   errors {off[0]:.0e} {off[1]:.0e}   {len(mine.events)} events, {mine.stats['loop']}",
        flush=True,
    )


def overlap(X) -> float:
    """Largest overlap of discs of radius 1 at the samples X (k, n)."""
    from scipy.spatial import cKDTree

    near = [
        x[p]
        for x in X.reshape(len(X), -1, 2)
        if len(p := cKDTree(x).query_pairs(2.0 + 1e-6, output_type="ndarray"))
    ]
    return max((float((2.0 - np.hypot(*(p[:, 0] - p[:, 1]).T)).max()) for p in near), default=0.0)


def main(argv=None) -> int:
    ap = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    ap.add_argument("--rounds", type=int, default=5)
    ap.add_argument(
        "--most", type=int, default=100, help="largest number of discs against the plain method"
    )
    ap.add_argument("--reach", type=float, default=0.33, help="end time of the run of 1000 discs")
    o = ap.parse_args(argv)
    import numba
    import scipy

    print(
        f"numpy {np.__version__}, scipy {scipy.__version__}, numba {numba.__version__}, load "
        f"{os.getloadavg()[0]:.1f}"
    )
    start = time.process_time()
    get("event_driven").prepare(get_case("three_discs"), 1e-12)
    print(f"preparing, with kernels compiled or loaded: {time.process_time() - start:.1f} s of CPU")
    print(f"{'':34s} {'nsbench':>12s} {'other':>13s}   ratio")
    three = get_case("three_discs")
    _modes(three)
    compare("three_discs, by hand, 1e-9", three, 1e-9, lambda: by_hand(three, 1e-10), o.rounds)
    for n in (3, 10, 30, 100):
        if n <= o.most:
            case = get_case("discs", n=n)
            rounds = min(o.rounds, 3 if n < 100 else 2)
            compare(
                f"discs[n={n}], plain, 1e-10",
                case,
                1e-10,
                lambda case=case: plain(case, 1e-10)[0],
                rounds,
            )
    case = get_case("discs", n=1000)
    case = case.replace(t=np.linspace(0.0, o.reach, 3))
    run = get("event_driven").prepare(case, 1e-10)
    start = time.process_time()
    traj = run()
    print(
        f"discs[n=1000] to t = {o.reach}: {time.process_time() - start:.2f} s, {len(traj.events)} "
        f"events, {traj.status.code}, "
        f"{traj.stats['loop']}; largest overlap at samples {overlap(traj.x):.0e}"
    )
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
