"""Position-based dynamics on the drift scene: how its seconds grow, and how near they are to what
the machine can do.

    python tests/studies/speed/pbd.py [--n 1000 10000 100000 1000000] [--rounds 3]

The scene is `peers_discs.drift_scene`: unit discs, area fraction 0.8, random unit velocities, h =
0.01, four walls.
A step is drift, certificate, rebuilds of the list and one sweep; a run is what `prepare` returns,
with its trajectory.

    growth    nanoseconds per disc and step, by order and labels; largest over smallest over the
              sizes
    sweep     one sweep of one list, in ways that differ in nothing else: a C loop over the pairs in
    the stated order (gcc -O3,
              contraction off: equal bits are checked), our sweep one after another, and by schedule
    peers     libraries that users have (peers_discs.py), sorted and random labels
    impulses  with their records over without
    memory    growth of the process in prepare and run, per disc, in a process of its own
"""

import argparse
import ctypes
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

import numpy as np  # noqa: E402
from peers_discs import STEP, drift_scene, peers  # noqa: E402

from nsbench.measure.clock import interleaved, ratio  # noqa: E402
from nsbench.solvers import get  # noqa: E402
from nsbench.solvers.base import grid  # noqa: E402

WORK = 2_000_000  # discs times steps of a timed run; 60 steps at least, more than a list lives
VARIANTS = (
    ("sorted", "rows"),
    ("cell", "rows"),
    ("coloured", "rows"),
    ("sorted", "random"),
    ("cell", "random"),
)

LOOP = """
#include <math.h>
long sweep(long m, const int *i, const int *j, double *x, double *mu, double d) {
    long work = 0;
    for (long c = 0; c < m; c++) {
        double *p = x + 2 * (long)i[c], *q = x + 2 * (long)j[c];
        double a = p[0] - q[0], b = p[1] - q[1], s = a * a + b * b;
        if (s >= d * d) continue;
        double r = sqrt(s), u = -0.5 * (r - d), w = u / r;
        a *= w; b *= w;
        p[0] += a; p[1] += b; q[0] -= a; q[1] -= b;
        mu[c] += u;
        work++;
    }
    return work;
}
"""

MEMORY = """
import os, sys
sys.path.insert(0, {here!r})
from peers_discs import STEP, drift_scene
from nsbench.solvers import get
def peak():
    return 1024 * next(int(v.split()[1]) for v in open("/proc/self/status") if v.startswith("VmHWM"))
def now():
    return 1024 * next(int(v.split()[1]) for v in open("/proc/self/status") if v.startswith("VmRSS"))
get("pbd").prepare(drift_scene(100, 5, warm=0).case, STEP)()
case = drift_scene({n}, {steps}, warm=0).case.replace(start="keep")
open("/proc/self/clear_refs", "w").write("5")
before = now()
run = get("pbd").prepare(case, STEP)
ready = now()
traj = run()
print((ready - before) / {n}, (peak() - before) / {n}, (now() - before) / {n}, len(traj.contacts) / {n})
"""


def steps_for(n):
    return int(np.clip(WORK // n, 60, 1000))


def growth(sizes, rounds):
    """Nanoseconds per disc and step of whole runs."""
    runs = {}
    for n in sizes:
        scenes = {
            labels: drift_scene(n, steps_for(n), labels)
            for labels in ("rows", "random")[: 2 if n < 10**6 else 1]
        }
        for order, labels in VARIANTS:
            if labels in scenes:
                runs[order, labels, n] = get(f"pbd[order={order}]").prepare(
                    scenes[labels].case, STEP
                )
    times = interleaved(runs, rounds)
    for order, labels in VARIANTS:
        ns = {
            n: 1e9 * times[order, labels, n].median / n / steps_for(n)
            for n in sizes
            if (order, labels, n) in times
        }
        print(
            f"growth   {order:>8}, {labels:>6} labels: "
            + "  ".join(f"{n}: {v:.1f} ns" for n, v in ns.items())
            + f"   largest over smallest {max(ns.values()) / min(ns.values()):.2f}"
        )
    for order in ("coloured", "cell"):
        for n in sizes:
            print(
                f"growth   whole step, sorted over {order}, rows, {n}: "
                f"{ratio(times['sorted', 'rows', n], times[order, 'rows', n])}"
            )


def compiled_loop():
    """The C loop, or None without gcc."""
    if not shutil.which("gcc"):
        return None
    folder = Path(tempfile.mkdtemp())
    (folder / "sweep.c").write_text(LOOP)
    subprocess.run(
        [
            "gcc",
            "-O3",
            "-march=native",
            "-ffp-contract=off",
            "-shared",
            "-fPIC",
            "-o",
            folder / "sweep.so",
            folder / "sweep.c",
            "-lm",
        ],
        check=True,
    )
    loop = ctypes.CDLL(str(folder / "sweep.so")).sweep
    loop.restype = ctypes.c_long
    shutil.rmtree(folder)
    return loop


def pair_lists(scene, order):
    """Positions by cells after a drift, and the near pairs there: as executed, and one after
    another as stated."""
    from numba import njit

    from nsbench.dynamics.contacts.kernels.constraint_order import COLOURED, SORTED
    from nsbench.dynamics.contacts.kernels.contact_arrays import AffineRows
    from nsbench.solvers.pbd.kernels import cell_loop, cell_storage, list_renewal

    @njit
    def candidates(data, state, arrays, reach):
        """The list that a run would begin with, and the keys of its candidates."""
        lists, counts, _, _ = list_renewal.initialise(data, state, arrays, state.y.copy(), reach)
        rows = np.empty(0, np.int32)
        lists, m, _ = cell_storage.rebuild(
            data, state, lists, counts.count, reach, rows, counts.max_pairs
        )
        keys = np.empty(m, np.uint64)
        pairs = cell_storage.listed(lists.arrays, m)
        cell_storage.fill_keys(pairs.i, pairs.j, state.label, data, keys)
        return pairs, keys

    x = scene.x0.ravel()
    n = len(scene.x0)
    data = cell_storage.CellScene(
        rows=AffineRows(np.zeros(1, np.int64), np.empty(0, np.int64), np.empty(0), np.empty(0)),
        b=np.empty(0),
        r=np.ones(1),
        ranks=np.empty(0, np.int64),
        families=np.zeros((1, 2), np.int64),
        dim=2,
        moving=False,
        order={"sorted": SORTED, "coloured": COLOURED}[order],
        seed=0,
        record=True,
    )
    state = cell_loop.cell_state(n, x.size)
    state.y[:] = x
    arrays = cell_storage.candidate_arrays.py_func(cell_loop.first_size(n))
    pairs, keys = candidates(data, state, arrays, 0.5)
    i = pairs.i.copy()
    j = pairs.j.copy()
    y = state.y
    label = state.label
    o = np.argsort(keys)
    y += STEP * scene.v[label].ravel()
    return y, (i, j), (i[o], j[o])


def ours(start, lists):
    """A run of our sweep over the list, certificate and records included; returns the positions."""
    from nsbench.compilation.decorators import python_entry
    from nsbench.dynamics.contacts.kernels.contact_arrays import AffineRows
    from nsbench.solvers.pbd.kernels import cell_sweep
    from nsbench.solvers.pbd.kernels.cell_storage import PairImpulses

    sweep_stored = python_entry(cell_sweep.sweep_stored)
    rows = AffineRows(np.zeros(1, np.int64), np.empty(0, np.int64), np.empty(0), np.empty(0))
    m = lists[0].size
    y = start.copy()
    base = start.copy()
    mu = np.zeros(m)
    log_at = np.empty(m, np.int32)
    log_mu = np.empty(m)
    active = PairImpulses(*lists, mu)

    def run():
        y[:] = start
        sweep_stored(active, y, base, np.ones(1), 2, rows, rows.inv2, 0.0625, log_at, log_mu, True)
        return y

    return run


def plain(loop, start, lists):
    """The same with the C loop."""
    y = start.copy()
    mu = np.zeros(lists[0].size)
    pointers = [a.ctypes.data_as(ctypes.c_void_p) for a in (*lists, y, mu)]

    def run():
        y[:] = start
        loop(ctypes.c_long(mu.size), *pointers, ctypes.c_double(2.0))
        return y

    return run


def sweeps(sizes, rounds):
    """One sweep: the C loop, ours one after another, ours by schedule."""
    loop = compiled_loop()
    if loop is None:
        print("sweep    gcc is not installed; left out.")
        return
    for n in sizes:
        scene = drift_scene(n, 1)
        runs = {}
        for order in ("sorted", "coloured"):
            y, executed, stated = pair_lists(scene, order)
            runs |= {
                f"{order}, C": plain(loop, y, stated),
                f"{order}, one after another": ours(y, stated),
                f"{order}, by schedule": ours(y, executed),
            }
        ends = {name: run().tobytes() for name, run in runs.items()}
        for order in ("sorted", "coloured"):
            same = len({v for name, v in ends.items() if name.startswith(order)}) == 1
            print(
                f"sweep    {n} discs, {order}: the three ways "
                f"{'agree in every bit' if same else 'DIFFER'}"
            )
        times = interleaved(runs, max(rounds, 5), least=0.1)
        c = times["sorted, C"]
        for name, value in times.items():
            print(
                f"sweep    {n} discs, {name:<29} {1e9 * value.median / n:6.1f} ns per disc; speed "
                f"over the C loop, sorted: "
                f"{ratio(c, value)}"
            )


def against_peers(sizes, rounds):
    for labels in ("rows", "random"):
        for n in sizes:
            steps = min(
                200, steps_for(n)
            )  # more than a list lives: none is charged for a few steps alone
            scene = drift_scene(n, steps, labels)
            runs, skipped = peers(scene, steps)
            orders = ("sorted", "cell", "coloured")
            runs |= {
                order: get(f"pbd[order={order}]").prepare(scene.case, STEP) for order in orders
            }
            times = interleaved(runs, rounds)
            for name in set(times) - set(orders):
                print(
                    f"peers    {n} discs, {labels:>6} labels, {name:<21} "
                    f"{1e9 * times[name].median / n / steps:8.1f} ns; over "
                    + "  ".join(f"{order} {ratio(times[name], times[order])}" for order in orders)
                )
            for why in skipped:
                print("peers    " + why)


def impulses(sizes, rounds):
    from nsbench.dynamics.contacts.constraint_set import ConstraintSet

    for n in sizes:
        case = drift_scene(n, steps_for(n)).case
        method = get("pbd")
        scene = ConstraintSet(case.problem, case.n)
        runs = {
            record: method._by_cells(case, scene, grid(case.t, STEP), case.x0, record)[0]
            for record in (True, False)
        }
        times = interleaved(runs, max(rounds, 5))
        print(f"impulses {n} discs: with records over without {ratio(times[True], times[False])}")


def memory(n, steps):
    code = MEMORY.format(here=str(Path(__file__).parent), n=n, steps=steps)
    out = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout.split()
    ready, peak, held, contacts = map(float, out)
    print(
        f"memory   {n} discs, {steps} steps: {ready:.0f} bytes per disc when prepared, {peak:.0f} "
        f"at most, {held:.0f} with the "
        f"trajectory of two samples and {contacts:.2f} contacts per disc"
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--n", type=int, nargs="+", default=[1000, 10_000, 100_000, 1_000_000])
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument(
        "--only", nargs="+", default=["growth", "sweep", "peers", "impulses", "memory"]
    )
    args = parser.parse_args()
    import numba
    import scipy

    print(
        f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores, load "
        f"{os.getloadavg()[0]:.1f}, numpy "
        f"{np.__version__}, scipy {scipy.__version__}, numba {numba.__version__}"
    )
    if "sweep" in args.only:
        sweeps([n for n in args.n if n > 1000], args.rounds)
    if "impulses" in args.only:
        impulses([n for n in args.n if n > 1000], args.rounds)
    if "growth" in args.only:
        growth(args.n, args.rounds)
    if "peers" in args.only:
        against_peers([n for n in args.n if 1000 < n <= 100_000], args.rounds)
    if "memory" in args.only:
        memory(max(args.n), 20)


if __name__ == "__main__":
    main()
