"""Faults, one at a time, that the gate must see: fourteen by name and twelve drawn at random; and
runs of the unbroken bench under load, which it must let pass.

    python tests/studies/gate_faults.py [WORD ...] [--seed N]
    python tests/studies/gate_faults.py --clean 100 [--busy N]

Every fault is a replacement of text (some are two) in a copy of the checkout. A small suite (CASES
x METHODS) is run and calibrated on the unbroken copy, then run with every fault, and held against
the unbroken one's baseline by `nsbench gate`; a fault is caught where that exits with 1 or 4, or
ends in an error of its own. Drawn faults (drawn_faults.py, with its seed) can lie in code that the
suite never runs, or change no number. A fault in the folder of a method is looked for in the runs
of that method alone. --clean N runs the unbroken suite N times beside processes that keep every
core busy (--busy: so many of them), and counts those that the gate does not let pass. WORD: only
faults whose names hold one of them. Exit status 1 if a named fault went unseen, no longer applies,
or a clean run was stopped.
"""

import argparse
import csv
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from copies import broken_in, copy
from drawn_faults import SEED, drawn
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
    "event times moved by 1e-4": (
        (
            "nsbench/solvers/event_driven/contacts/host_loop.py",
            "            tuple(self.events),\n",
            "            tuple(Event(e.t + 1e-4, e.kind, e.contact) for e in self.events),\n",
        ),
        (
            "nsbench/solvers/event_driven/filippov/host_loop.py",
            "            tuple(self.events),\n",
            "            tuple(Event(e.t + 1e-4, e.kind, e.contact) for e in self.events),\n",
        ),
    ),
    "Filippov impulses times 1.0001": (
        "nsbench/solvers/event_driven/filippov/host_loop.py",
        "            self.W,\n",
        "            1.0001 * self.W,\n",
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


def nsbench(folder, *args, kernels=None):
    """Exit status and output of the command line of a copy, with caches of its own; kernels: the
    folder of compiled kernels."""
    env = os.environ | {
        "PYTHONPATH": str(folder),
        "NUMBA_CACHE_DIR": str(kernels or folder / ".kernels"),
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


def suite(folder, methods=METHODS, kernels=None):
    """Run the suite in a copy; its results lie in the folder `results` there, and no older ones."""
    chosen = [word for m in methods for word in ("-s", m)]
    results = folder / "results"
    shutil.rmtree(results, ignore_errors=True)
    return nsbench(folder, "run", *CASES, *chosen, "-o", results, "--force", kernels=kernels)


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


def methods_of(files):
    """The methods whose runs can change by an edit of the files: those of their folders, or all."""
    owners = {f.split("/")[2] if f.startswith("nsbench/solvers/") else "" for f in files}
    own = [m for m in METHODS if m.partition("[")[0] in owners]
    return own if len(owners) == 1 and own else METHODS


def lines_of(methods, path, to):
    """Write the lines of some methods of a baseline to another file."""
    with open(path, newline="", encoding="utf-8") as file:
        head, *rows = csv.reader(file)
    with open(to, "w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([head, *(r for r in rows if r[1] in methods)])
    return to


def is_kernel(file) -> bool:
    """Does an edit of the file compile all kernels anew?"""
    from nsbench.compilation import numba_cache

    root = numba_cache.ROOT.parent
    return file in {p.relative_to(root).as_posix() for p in numba_cache.kernel_files()}


def attempt(folder, path, replacements) -> tuple[int, str]:
    """Exit status of the gate with a fault, and the last line that it said."""
    files = [file for file, _, _ in replacements]
    methods = methods_of(files)
    with tempfile.TemporaryDirectory() as scratch, broken_in(folder, *replacements):
        kernels = scratch if any(map(is_kernel, files)) else None
        ran, _ = suite(folder, methods, kernels)
        lines = lines_of(methods, path, Path(scratch) / "baseline.csv")
        status, said = nsbench(folder, "gate", folder / "results", "--baseline", lines)
    return status, f"(run {ran}); {(said.strip().splitlines() or ['nothing'])[-1]}"


def faults(folder, chosen, path, seed) -> int:
    """How many named faults went unseen; drawn ones are told apart."""
    unseen = {"named": [], "drawn": []}
    told = 0
    both = {name: ("named", fault) for name, fault in FAULTS.items()}
    both |= {name: ("drawn", fault) for name, fault in drawn(seed).items()}
    for name, (source, fault) in both.items():
        if chosen and not any(c in name for c in chosen):
            continue
        began = time.perf_counter()
        replacements = fault if isinstance(fault[0], tuple) else (fault,)
        try:
            status, said = attempt(folder, path, replacements)
        except LookupError as e:
            status = 0
            said = str(e)
        told += 1
        if status == 0:
            unseen[source].append(name)
        print(
            f"{name:34} {'caught' if status else 'NOT SEEN'}: gate {status} {said} "
            f"[{time.perf_counter() - began:.0f} s]",
            flush=True,
        )
    print(
        f"{told} faults; not seen: {len(unseen['named'])} named, {len(unseen['drawn'])} drawn with "
        f"seed {seed}"
    )
    return len(unseen["named"])


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
    p.add_argument("names", nargs="*", metavar="WORD")
    p.add_argument("--seed", type=int, default=SEED, metavar="N")
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
            bad = faults(folder, args.names, path, args.seed)
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
