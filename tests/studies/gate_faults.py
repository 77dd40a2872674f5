"""Twelve faults, one at a time, that the gate must see; and runs of the unbroken bench under load,
which it must let pass.

    python tests/studies/gate_faults.py [NAME ...]
    python tests/studies/gate_faults.py --clean 100 [--busy N]

Every fault is a replacement of text (one is two) in a copy of the checkout. A small suite (CASES x
METHODS) is run and calibrated on an unbroken copy, then run on every broken one, each with kernels
of its own, and held against the unbroken one's baseline by `nsbench gate`; a fault is caught where
that exits with 1 or 4. --clean N runs the unbroken suite N times beside processes that keep every
core busy (--busy: so many of them), and counts those that the gate does not let pass. Exit status 1
if a fault went unseen, no longer applies, or a clean run was stopped.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from copies import broken, copy
from mutations import SWEEP

CASES = ("tide", "three_discs", "discs[n=10]", "two_discs[w=1]", "slide_exit", "relay_lcs")
METHODS = ("pbd", "catching_up", "event_driven", "euler[implicit=true]", "theta")
FAULTS = {
    "a prox dropped": SWEEP,
    "sign of lambda": (
        "nsbench/solvers/pbd/kernels/projection.py",
        "            mu[c] += m\n",
        "            mu[c] -= m\n",
    ),
    "half of every step": (
        "nsbench/solvers/common/time_grid.py",
        '    check_positive("h", h)\n    spacing',
        "    h = 0.5 * h\n    spacing",
    ),
    "last step skipped": (
        "nsbench/solvers/pbd/kernels/listed_loop.py",
        "for s in range(substeps[k]):",
        "for s in range(substeps[k] - (k == K - 2)):",
    ),
    "order of the constraints": (
        "nsbench/dynamics/contacts/kernels/constraint_order.py",
        "    if order == REVERSE:",
        "    if order == SORTED:",
    ),
    "tolerance 100 times looser": (
        "nsbench/solvers/event_driven/method.py",
        'tol = check_positive("tol", accuracy)',
        'tol = 100.0 * check_positive("tol", accuracy)',
    ),
    "margin of neighbours too small": (
        "nsbench/solvers/pbd/kernels/cell_search.py",
        "d2 = (2.0 * r[0] + skin) ** 2",
        "d2 = (2.0 * r[0] - 0.01) ** 2",
    ),
    "single precision": (
        "nsbench/solvers/pbd/kernels/listed_loop.py",
        "x[c] += h * v[c]",
        "x[c] = np.float32(x[c] + h * v[c])",
    ),
    "wrong time of the multiplier": (
        "nsbench/solvers/pbd/method.py",
        'lam_time="start"',
        'lam_time="end"',
    ),
    "stale reference": (
        ("cases/three_discs.py", "        return -x\n", "        return -1.001 * x\n"),
        ("nsbench/reference/storage.py", "    if wrong:\n", "    if False:\n"),
    ),
    "fewer steps": (
        "nsbench/solvers/common/time_grid.py",
        "np.ceil(spacing / h * (1 - 1e-9)))",
        "np.ceil(spacing / h * 0.5))",
    ),
    "a method that refuses everything": (
        "nsbench/solvers/catching_up/method.py",
        "    def refuses(self, case: Case) -> str | None:",
        "    def refuses(self, case):\n        return 'No.'\n\n    def other(self, case):",
    ),
}


def whole_copy(folder):
    """A copy of the checkout whose cases and references are its own, not those of the installed
    package."""
    copy(folder)
    for name in ("cases", "reference_solutions"):
        (folder / "nsbench" / name).symlink_to(folder / name)


def nsbench(folder, *args):
    """Exit status and output of the command line of a copy, with caches of its own."""
    env = os.environ | {
        "PYTHONPATH": str(folder),
        "NUMBA_CACHE_DIR": str(folder / ".kernels"),
        "XDG_CACHE_HOME": str(folder / ".cache"),
    }
    done = subprocess.run(
        [sys.executable, "-m", "nsbench", *map(str, args)],
        cwd=folder,
        env=env,
        capture_output=True,
        text=True,
    )
    return done.returncode, done.stdout + done.stderr


def suite(folder):
    """Results of the suite in a copy."""
    chosen = [word for m in METHODS for word in ("-s", m)]
    return nsbench(folder, "run", *CASES, *chosen, "-o", folder / "results", "--force")


def baseline(folder):
    """The baseline of an unbroken copy."""
    path = folder / "baseline.csv"
    for args in (
        ("calibrate", folder / "results"),
        ("gate", folder / "results", "--baseline", path, "--update", "--reason", "unbroken"),
    ):
        status, said = nsbench(folder, *args)
        if status:
            raise SystemExit(f"{args[0]} on the unbroken bench: {said}")
    return path


def faults(chosen, path) -> int:
    """How many faults went unseen."""
    unseen = 0
    for name, fault in FAULTS.items():
        if chosen and not any(c in name for c in chosen):
            continue
        try:
            with broken(
                *(fault if isinstance(fault[0], tuple) else (fault,)), copied=whole_copy
            ) as folder:
                ran, _ = suite(folder)
                status, said = nsbench(folder, "gate", folder / "results", "--baseline", path)
        except LookupError as e:
            ran = None
            status = 0
            said = str(e)
        unseen += status not in (1, 4)
        print(
            f"{name:34} {'caught' if status in (1, 4) else 'NOT SEEN'}: gate {status} (run {ran}); "
            f"{said.strip().splitlines()[-1]}",
            flush=True,
        )
    return unseen


def clean(folder, path, times, others) -> int:
    """How many of the runs of the unbroken bench under load are stopped by the gate."""
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(others)]
    try:
        alarms = 0
        for k in range(times):
            suite(folder)
            status, said = nsbench(folder, "gate", folder / "results", "--baseline", path)
            alarms += status != 0
            print(
                f"run {k + 1}, load {os.getloadavg()[0]:.1f}: gate {status}; "
                f"{said.strip().splitlines()[-1]}",
                flush=True,
            )
            if status:
                print(said, flush=True)
    finally:
        for p in busy:
            p.kill()
    return alarms


def main() -> int:
    p = argparse.ArgumentParser()
    p.add_argument("names", nargs="*")
    p.add_argument("--clean", type=int, default=0, metavar="N")
    p.add_argument("--busy", type=int, default=os.cpu_count() or 1, metavar="N")
    args = p.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        whole_copy(folder)
        status, said = suite(folder)
        if status:
            raise SystemExit(f"the unbroken bench: {said}")
        path = baseline(folder)
        if args.clean:
            bad = clean(folder, path, args.clean, args.busy)
            print(f"{bad} of {args.clean} clean runs under load were stopped")
        else:
            bad = faults(args.names, path)
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
