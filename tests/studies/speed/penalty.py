"""The penalty's seconds: what the second call saves, what extrapolation in k is worth, and the
stiffness wall.

    python tests/studies/speed/penalty.py            (--wall 0 to skip the wall)

1. Second call: nsbench.solve twice on one scene, each pair in a fresh process: with an empty folder
of programs (traced
   and compiled), then with the folder the first process left (found by fingerprint). Seconds of the
   first call include the import of JAX; "traced" is the same less that import. At least 20 is
   wanted of first over second.
2. Extrapolation: seconds to an error of 1e-8 on three_discs, (x(k) - 6 x(2k) + 8 x(4k)) / 3 and 2
x(2k) - x(k), against
   the plain penalty at k = 1e6 (error about 1e-6), by whichever integrator is faster there; one
   interleaved series.
3. The wall: error, steps, seconds and status for k = 1e2 ... 1e10 and each integrator: where it
begins to fail, and that
   it says so. An error that is no longer 1/k with status ok would be a fault of this bench.
"""

import argparse
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from importlib import metadata

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

import numpy as np  # noqa: E402

import nsbench  # noqa: E402
from nsbench import solvers  # noqa: E402
from nsbench.measure.clock import interleaved, ratio  # noqa: E402

CALLS = """
import json, sys, time
import nsbench
def clock(f):
    start = time.perf_counter(); f(); return time.perf_counter() - start
name, k = sys.argv[1], float(sys.argv[2])
import numpy
library = clock(lambda: __import__("jax"))
first = clock(lambda: nsbench.solve(name, "penalty", k=k))
later = sorted(clock(lambda: nsbench.solve(name, "penalty", k=k * (1 + 1e-3 * i))) for i in range(1, 8))
print(json.dumps([library, first, later[0], later[3], later[-1], "diffrax" in sys.modules]))
"""


def second_call(name: str, k: float):
    print(
        f"\n{name}, k = {k:g}      import jax   first call   second (least, median, most of 7)   "
        f"first / second"
    )
    with tempfile.TemporaryDirectory() as folder:
        for what in ("traced and compiled", "found on disk"):
            out = subprocess.run(
                [sys.executable, "-c", CALLS, name, str(k)],
                capture_output=True,
                text=True,
                check=True,
                env=os.environ | {"XDG_CACHE_HOME": folder},
            )
            library, first, least, middle, most, traced = json.loads(out.stdout)
            print(
                f"  {what:<22s}{library:10.2f}{first:13.3f}     {least:9.4f} {middle:9.4f} "
                f"{most:9.4f}"
                f"{first / middle:20.0f}   diffrax {'loaded' if traced else 'not loaded'}"
            )


def ready(case, spec, k):
    """(run, its error)."""
    run = solvers.get(spec).prepare(case, k)
    traj = run()
    return run, nsbench.errors(case, traj)["state_sup"], traj


def extrapolation(goal: float):
    case = nsbench.get_case("three_discs")
    found = {}
    for spec, ks in (
        ("penalty[extrapolate=1]", np.geomspace(2e3, 1.6e4, 7)),
        ("penalty[extrapolate=1,method=kvaerno5]", np.geomspace(2e3, 1.6e4, 7)),
        ("penalty[extrapolate=2]", np.geomspace(500.0, 1600.0, 9)),
    ):
        for k in ks:
            run, error, traj = ready(case, spec, k)
            if traj.status.ok and error <= goal:
                found[f"{spec}, k = {k:.0f}"] = (run, error)
                break
    for method in ("tsit5", "kvaerno5"):
        run, error, _ = ready(case, f"penalty[method={method},max_steps=4000000]", 1e6)
        found[f"penalty[method={method}], k = 1e6"] = (run, error)
    times = interleaved({n: r for n, (r, _) in found.items()}, rounds=3)
    plain = min((n for n in found if "k = 1e6" in n), key=lambda n: times[n].median)
    print(
        f"\nthree_discs to {goal:g}                      error     seconds   over plain at k = "
        f"1e6 (the faster of two)"
    )
    for n, (_, error) in found.items():
        print(f"  {n:<50s}{error:10.1e}{times[n].median:10.3f}   {ratio(times[n], times[plain])}")


def wall(name: str):
    case = nsbench.get_case(name)
    print(f"\n{name}: k, then for each integrator error (times k), steps, seconds, status")
    methods = ("tsit5", "kvaerno3", "kvaerno5")
    for k in 10.0 ** np.arange(2, 11):
        cells = []
        for method in methods:
            run = solvers.get(f"penalty[method={method},max_steps=300000]").prepare(case, k)
            start = time.perf_counter()
            traj = run()
            seconds = time.perf_counter() - start
            whole = np.isfinite(traj.x).all() and len(traj.t) == len(case.t)
            error = nsbench.errors(case, traj)["state_sup"] if whole else float("nan")
            cells.append(
                f"{error:8.1e} ({error * k:7.2f}) {traj.stats['steps']:7d} {seconds:7.3f} "
                f"{traj.status.code:<10s}"
            )
        print(f"  {k:7.0e}  " + " | ".join(cells))
    print("           " + " | ".join(f"{m:<44s}" for m in methods))


def many():
    print("\nhard discs, all pairs against near ones (T = 0.05, k = 300)")
    for n in (30, 100):
        case = nsbench.get_case("discs", n=n)
        case = case.replace(t=np.linspace(0.0, 0.05, 3))
        runs = {p: solvers.get(f"penalty[pairs={p}]").prepare(case, 300.0) for p in ("all", "near")}
        a, b = (r() for r in runs.values())
        times = interleaved(runs, rounds=3)
        print(
            f"  n = {n:5d}: near over all {ratio(times['near'], times['all'])}, "
            f"largest difference {np.abs(a.x - b.x).max():.1e}"
        )
    case = nsbench.get_case("discs", n=1000)
    run = solvers.get("penalty").prepare(case.replace(t=np.linspace(0.0, 0.3, 3)), 300.0)
    start = time.perf_counter()
    traj = run()
    seconds = time.perf_counter() - start
    s = traj.stats
    print(
        f"  n =  1000, T = 0.3: {s['steps'] + s['refused_steps']} steps, {s['segments']} "
        f"segments, {seconds:.2f} s, "
        f"{traj.status.code}, {len(traj.contacts)} contacts of 499500 pairs"
    )


def main():
    args = argparse.ArgumentParser()
    args.add_argument("--wall", type=int, default=1)
    args = args.parse_args()
    names = ("jax", "jaxlib", "diffrax", "numpy")
    print(
        f"python {platform.python_version()}, "
        + ", ".join(f"{n} {metadata.version(n)}" for n in names)
        + f", {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}"
    )
    for name in ("tide", "three_discs", "discs[n=30]"):
        second_call(name, 100.0)
    extrapolation(1e-8)
    many()
    if args.wall:
        wall("tide")
        wall("three_discs")
    print(f"load at the end {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()
