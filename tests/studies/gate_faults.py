"""Faults, one at a time, that the gate must see: fourteen by name and twelve drawn at random; and
runs of the unbroken bench under load, which it must let pass.

    python tests/studies/gate_faults.py [WORD ...] [--seed N]
    python tests/studies/gate_faults.py --clean 100 [--busy N]

Every fault is a replacement of text (some are two) in a copy of the checkout. The suite of
gate_suite.py is run and calibrated on the unbroken copy, then run with every fault, and held
against the unbroken one's baseline by `nsbench gate`; a fault is caught where that exits with 1 or
4, or ends in an error of its own or not at all. A fault in the gate itself is caught as well where
calibration and baseline of one method come out otherwise. Drawn faults (drawn_faults.py, with its
seed) can lie in code that the suite never runs: of those that the gate does not see, the quick
tests that import the file tell whether they do. A fault is looked for in the runs of the methods
that import its file, or of all. --clean N runs the unbroken suite N times beside processes that
keep every core busy (--busy: so many of them), and counts those that the gate does not let pass.
WORD: only faults whose names hold one of them. Exit status 1 if a named fault went unseen, no
longer applies, or a clean run was stopped.
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

from copies import broken_in, copy, is_kernel
from drawn_faults import SEED, drawn
from gate_suite import METHODS
from imports import reached, tests_of
from mutations import SWEEP

HERE = Path(__file__).parent
HANGS = 600  # seconds: a fault can make a loop endless
TESTS = 3 * HANGS  # of all quick tests of a file, which may compile kernels
NO_END = 124  # exit status of what was ended then, as that of timeout(1)
ONE = ("tide", "pbd")  # case and method for which the gate itself is tried
FAULTS = {
    "a prox dropped": SWEEP,
    "sign of lambda": (
        "nsbench/solvers/pbd/kernels/projection.py",
        "            mu[c] += m\n",
        "            mu[c] -= m\n",
    ),
    "half of every step": (
        "nsbench/solvers/common/time_grid.py",
        "    if np.all(h <= spacing * (1 + 1e-9)):\n",
        "    h = 0.5 * h\n    if np.all(h <= spacing * (1 + 1e-9)):\n",
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
    package; two cases are added."""
    copy(folder)
    for name in ("cases", "reference_solutions"):
        (folder / "nsbench" / name).symlink_to(folder / name)
    for name in ("curved_floor.py", "kinked_fields.py"):
        shutil.copy2(HERE / name, folder / "cases")


def python(folder, *args, kernels=None, seconds=None):
    """Exit status and output of Python in a copy, with caches of its own; kernels: the folder of
    compiled kernels; seconds: after which it is ended."""
    env = os.environ | {
        "PYTHONPATH": str(folder),
        "NUMBA_CACHE_DIR": str(kernels or folder / ".kernels"),
        "XDG_CACHE_HOME": str(folder / ".cache"),
    }
    command = [sys.executable, *map(str, args)]
    try:
        done = subprocess.run(
            command, cwd=folder, env=env, capture_output=True, text=True, timeout=seconds
        )
    except subprocess.TimeoutExpired:
        return NO_END, f"does not end within {seconds} s"
    return done.returncode, done.stdout + done.stderr


def suite(folder, *options, methods=METHODS, kernels=None, seconds=None):
    """Run the suite in a copy; its results lie in the folder `results` there, and no older ones."""
    chosen = [word for m in methods for word in ("-s", m)]
    results = folder / "results"
    shutil.rmtree(results, ignore_errors=True)
    script = HERE / "gate_suite.py"
    return python(folder, script, results, *chosen, *options, kernels=kernels, seconds=seconds)


def baseline(folder, name="baseline.csv", seconds=None):
    """The baseline of the results in a copy."""
    path = folder / name
    path.unlink(missing_ok=True)
    for args in (
        ("calibrate", folder / "results", "-j", "1"),
        ("gate", folder / "results", "--baseline", path, "--update", "--reason", "unbroken"),
    ):
        status, said = python(folder, "-m", "nsbench", *args, seconds=seconds)
        if status:
            raise ChildProcessError(f"{args[0]}: {said.strip()[-300:]}")
    return path


def baseline_of_one(folder, seconds=None) -> str:
    """The text of a baseline that is made anew of one case and method."""
    suite(folder, "--cases", ONE[0], methods=ONE[1:], seconds=seconds)
    return baseline(folder, "one.csv", seconds).read_text(encoding="utf-8")


def methods_of(files):
    """The methods whose runs can change by an edit of the files: those that import them, or all."""
    own = set()
    for file in files:
        name = {m: f"nsbench/solvers/{m.partition('[')[0]}/method.py" for m in METHODS}
        users = {m for m in METHODS if file == name[m] or file in reached(name[m])}
        if not users:
            return METHODS
        own |= users
    return tuple(m for m in METHODS if m in own)


def lines_of(methods, path, to):
    """Write the lines of some methods of a baseline to another file."""
    with open(path, newline="", encoding="utf-8") as file:
        head, *rows = csv.reader(file)
    with open(to, "w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([head, *(r for r in rows if r[1] in methods)])
    return to


def attempt(folder, path, replacements, one, kernels=None) -> tuple[int, str]:
    """Exit status of the gate with a fault, and the last line that it said.

    one: text of the unbroken baseline of one method, for faults in the gate itself. kernels: the
    folder of those that are compiled with a fault in one of them, else one for this attempt.
    """
    files = [file for file, _, _ in replacements]
    methods = methods_of(files)
    with tempfile.TemporaryDirectory() as scratch, broken_in(folder, *replacements):
        if any(map(is_kernel, files)):
            kernels = kernels or scratch
        else:
            kernels = None
        lines = lines_of(methods, path, Path(scratch) / "baseline.csv")
        options = {"methods": methods, "kernels": kernels, "seconds": HANGS}
        status, said = suite(folder, "--baseline", lines, **options)
        if not status and any(f.startswith("nsbench/gate/") for f in files):
            try:
                status = int(baseline_of_one(folder, HANGS) != one)
            except ChildProcessError as e:
                status, said = 1, str(e)
    return status, (said.strip().splitlines() or ["nothing"])[-1]


def failing(folder, tests, kernels=None) -> list[str]:
    """The quick tests of some files that fail in a copy."""
    options = ("-m", "pytest", "-q", "-n0", "-p", "no:cacheprovider", "-m", "not long")
    options += ("--continue-on-collection-errors",)  # the copy has no reports
    said = python(folder, *options, *tests, kernels=kernels, seconds=TESTS)[1]
    failed = [x for x in said.splitlines() if x.startswith(("FAILED", "ERROR"))]
    return [x.partition(" ")[2].partition(" - ")[0] for x in failed]


def failing_by(folder, replacements) -> list[str]:
    """The quick tests that import the files and fail with a fault, but not without it."""
    files = [file for file, _, _ in replacements]
    tests = dict.fromkeys(t for file in files for t in tests_of(file))
    anyway = failing(folder, tests)
    with tempfile.TemporaryDirectory() as scratch, broken_in(folder, *replacements):
        kernels = scratch if any(map(is_kernel, files)) else None
        return [t for t in failing(folder, tests, kernels) if t not in anyway]


def faults(folder, chosen, path, seed, one) -> int:
    """How many named faults went unseen by the gate; drawn ones are told apart."""
    unseen = {"named": [], "drawn": []}
    by_test = 0
    told = 0
    both = {name: ("named", fault) for name, fault in FAULTS.items()}
    both |= {name: ("drawn", fault) for name, fault in drawn(seed, folder).items()}
    for name, (source, fault) in both.items():
        if chosen and not any(c in name for c in chosen):
            continue
        began = time.perf_counter()
        replacements = fault if isinstance(fault[0], tuple) else (fault,)
        try:
            status, said = attempt(folder, path, replacements, one)
        except LookupError as e:
            status = 0
            said = str(e)
        told += 1
        tests = []
        if status == 0:
            unseen[source].append(name)
            tests = failing_by(folder, replacements)
            by_test += bool(tests)
        print(
            f"{name:34} {'caught' if status else 'NOT SEEN'}: gate {status} {said} "
            f"[{time.perf_counter() - began:.0f} s]{''.join(f'; fails: {t}' for t in tests[:1])}",
            flush=True,
        )
    print(
        f"{told} faults; not seen by the gate: {len(unseen['named'])} named, "
        f"{len(unseen['drawn'])} drawn with seed {seed}; {by_test} of them by quick tests"
    )
    return len(unseen["named"])


def clean(folder, path, times, others) -> int:
    """How many of the runs of the unbroken bench under load are stopped by the gate."""
    idle = [sys.executable, "-c", "import os; os.nice(10)\nwhile True: pass"]
    busy = [subprocess.Popen(idle) for _ in range(others)]
    try:
        alarms = 0
        for k in range(times):
            status, said = suite(folder, "--baseline", path)
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
        status, said = suite(folder, "--reference")
        if not status:
            status, said = suite(folder)
        if status:
            raise SystemExit(f"the unbroken bench: {said}")
        path = baseline(folder)
        if args.clean:
            bad = clean(folder, path, args.clean, args.busy)
            print(f"{bad} of {args.clean} clean runs under load were stopped")
        else:
            one = baseline_of_one(folder)
            bad = faults(folder, args.names, path, args.seed, one)
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
