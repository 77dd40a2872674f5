"""Mutants: small faults drawn at random from four rooms, and whether a test or the gate sees them.

    python tests/studies/mutants.py [--count 500] [--seed 1] [--rooms measure gate] [--minutes 60]

Kinds: a changed operator or comparison, a changed constant, a shifted index, a dropped line
(drawn_faults.py). Each mutant lies in a copy of the checkout. It goes through stages, up to the
first that sees it: the quick tests that run its line (covering_tests.py; of compiled kernels, those
of its callers), up to --limit seconds; the suite of gate_suite.py and its baseline; the long tests
of its module. --last leaves the later stages to another call. The copy, with its map of the tests
and its compiled kernels, is kept in a folder of the user's cache, and outcomes are written to a
journal there as they come: the same command goes on where the last one ended, --again starts anew.
Prints the counts of each room, and all survivors with the reason that is known
(equivalent_faults.py); exit status 1 if there is one without.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from pathlib import Path

import kernel_stamps
from copies import ROOT, broken_in, is_kernel
from covering_tests import CoveringTests, make_map
from drawn_faults import ROOMS, changed, mutants, named
from equivalent_faults import reason
from gate_faults import attempt, baseline, baseline_of_one, suite, whole_copy
from imports import tests_of

SLOWER = 2.0  # times the seconds of the unbroken tests, after which a mutant is said to hang
START = 30.0  # seconds more, of a process that starts
COMPILES = 120.0  # seconds more, of one that compiles the kernels that hold a mutant
HANGS = 45  # seconds of one test, after which its process is ended
WHOLE = 600.0  # seconds of one test of the unbroken copy, at most
QUICK = "not long"
LONG = "long"
STAGES = ("tests", "gate", "long")
PYTEST = ("-m", "pytest", "-q", "-n0", "-p", "no:cacheprovider")
NO_TESTS = 5  # what pytest exits with where none was chosen


class Bench:
    """A copy of the checkout: its compiled kernels, the map of its tests, its suite's baseline."""

    def __init__(self, folder: Path, limit: float):
        self.folder = folder
        self.limit = limit
        self.sound: dict[str, bool] = {}  # by test: does it pass by itself?
        self.failing: dict[str, list[str]] = {}  # by files: their long tests that fail unbroken
        self.env = os.environ | {
            "PYTHONPATH": str(folder),
            "XDG_CACHE_HOME": str(folder / ".cache"),
            "NUMBA_CACHE_DIR": str(folder / ".kernels"),
        }

    def prepare(self) -> Bench:
        """Copy the checkout, run its tests under coverage and the suite of the gate."""
        whole_copy(self.folder)
        kernel_stamps.install(self.folder)
        make_map(self.folder, self.env)
        suite(self.folder, "--reference")
        suite(self.folder)
        path = baseline(self.folder)
        status, said = suite(self.folder, "--baseline", path)
        if status:
            raise SystemExit(f"the unbroken bench: {said}")
        (self.folder / "one.txt").write_text(baseline_of_one(self.folder), encoding="utf-8")
        return self.opened()

    def opened(self) -> Bench:
        """Read the map."""
        self.covering = CoveringTests(self.folder, is_kernel)
        return self

    def twin(self, folder: Path) -> Bench:
        """Return a bench in another folder with the same kernels."""
        shutil.copytree(self.folder, folder, symlinks=True, dirs_exist_ok=True)
        for name in ("cases", "reference_solutions"):
            (folder / "nsbench" / name).unlink()
            (folder / "nsbench" / name).symlink_to(folder / name)
        kernel_stamps.rename_stores(folder / ".kernels", self.folder, folder)
        return Bench(folder, self.limit).opened_from(self)

    def opened_from(self, other: Bench) -> Bench:
        """Take the map of another bench."""
        self.covering = other.covering
        return self

    def quick(self, tests: list[str]) -> list[str]:
        """Return the first tests, as many as take no longer than the limit together."""
        out = []
        left = self.limit
        for test in tests:
            left -= self.covering.seconds.get(test, 0.0)
            if left < 0.0:
                break
            out.append(test)
        return out

    def tested(
        self, tests: list[str], marks: str, kernels: Path, seconds: float, without=(), first=True
    ) -> tuple[str, list[str]]:
        """Run tests, to the first failure or to the end: an outcome, and the tests that failed."""
        hangs = HANGS + self.limit * (marks == LONG)
        hangs += COMPILES * (kernels != self.folder / ".kernels")
        command = [sys.executable, *PYTEST]
        command += ["-x"] if first else []
        command += ["-o", f"faulthandler_timeout={hangs:.0f}"]
        command += ["-o", "faulthandler_exit_on_timeout=true", "-m", marks]
        command += [word for test in without for word in ("--deselect", test)]
        env = self.env | {"NUMBA_CACHE_DIR": str(kernels)}
        try:
            done = subprocess.run(
                [*command, *tests],
                cwd=self.folder,
                env=env,
                capture_output=True,
                text=True,
                timeout=seconds,
            )
        except subprocess.TimeoutExpired:
            return "timeout", []
        lines = [x for x in done.stdout.splitlines() if x.startswith(("FAILED", "ERROR"))]
        survived = done.returncode in (0, NO_TESTS)
        failed = [x.partition(" ")[2].partition(" - ")[0] for x in lines]
        return ("survived" if survived else "killed"), failed

    def killed_by(self, fault, tests: list[str], marks: str, kernels: Path, seconds: float):
        """Run tests on a mutant; a test that fails on the unbroken copy too says nothing."""
        without = self.unsound(tests) if marks == LONG else []
        while tests:
            with broken_in(self.folder, fault), kernel_stamps.mutated(self.folder, fault[0]):
                said, failed = self.tested(tests, marks, kernels, seconds, without)
            by = failed[0] if failed else "?"
            if said != "killed" or "::" not in by or self.is_sound(by, marks):
                return said, by
            without.append(by)
        return "survived", ""

    def unsound(self, files: list[str]) -> list[str]:
        """Return the long tests of files that fail in the unbroken copy, looked up once."""
        key = " ".join(files)
        if key not in self.failing:
            kernels = self.folder / ".kernels"
            self.failing[key] = self.tested(files, LONG, kernels, WHOLE, first=False)[1]
        return list(self.failing[key])

    def is_sound(self, test: str, marks: str) -> bool:
        """Does a test pass by itself in the unbroken copy?"""
        if test not in self.sound:
            kernels = self.folder / ".kernels"
            self.sound[test] = self.tested([test], marks, kernels, WHOLE)[0] == "survived"
        return self.sound[test]

    def outcome(self, fault, line: int, stages: list[str]) -> dict:
        """Try one mutant in stages, up to the first that sees it."""
        with tempfile.TemporaryDirectory() as scratch:
            for stage in stages:
                said, by = getattr(self, stage)(fault, line, Path(scratch) / "kernels")
                if said != "survived":
                    return {"outcome": said, "by": by, "stage": stage}
        whole = stages[-1] == STAGES[-1]
        return {"outcome": "survived" if whole else "open", "by": "", "stage": stages[-1]}

    def tests(self, fault, line: int, kernels: Path) -> tuple[str, str]:
        """Run the quick tests that run the line."""
        tests = self.quick(self.covering.of(fault[0], line))
        seconds = START + COMPILES * is_kernel(fault[0])
        seconds += SLOWER * sum(self.covering.seconds[t] for t in tests)
        return self.killed_by(fault, tests, QUICK, self.kernels_of(fault, kernels), seconds)

    def gate(self, fault, line: int, kernels: Path) -> tuple[str, str]:
        """Run the suite of the gate, and compare it with its baseline."""
        path, one = self.folder / "baseline.csv", (self.folder / "one.txt").read_text("utf-8")
        with kernel_stamps.mutated(self.folder, fault[0]):
            kernels = self.kernels_of(fault, kernels)
            seen = attempt(self.folder, path, (fault,), one, kernels)[0]
        return ("gate", "gate") if seen else ("survived", "")

    def long(self, fault, line: int, kernels: Path) -> tuple[str, str]:
        """Run the long tests of the file."""
        seconds = 2.0 * self.limit + COMPILES * is_kernel(fault[0])
        kernels = self.kernels_of(fault, kernels)
        return self.killed_by(fault, tests_of(fault[0]), LONG, kernels, seconds)

    def kernels_of(self, fault, scratch: Path) -> Path:
        """Return the folder of compiled kernels: one of its own for a mutant of a kernel."""
        if not is_kernel(fault[0]):
            return self.folder / ".kernels"
        if not scratch.exists():
            shutil.copytree(self.folder / ".kernels", scratch)
        return scratch


def journal_path(seed: int) -> Path:
    """Return the file of the outcomes, below the user's cache."""
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return cache / "nsbench" / "mutants" / f"seed_{seed}.jsonl"


def known(path: Path) -> dict[str, dict]:
    """Return the outcomes of earlier runs by title."""
    if not path.exists():
        return {}
    return {r["title"]: r for r in map(json.loads, path.read_text(encoding="utf-8").splitlines())}


def report(results: list[dict], count: int) -> int:
    """Print counts and survivors; returns how many survivors have no reason."""
    for room in dict.fromkeys(r["room"] for r in results):
        print(room, dict(Counter(r["outcome"] for r in results if r["room"] == room)))
    bad = 0
    for r in results:
        if r["outcome"] == "survived":
            why = reason(r["title"], r["named"])
            bad += not why
            print(f"SURVIVED {r['title']}: {why or 'no reason is known'}")
    left = sum(r["outcome"] == "open" for r in results)
    print(
        f"{len(results)} of {count} mutants were tried; {bad} survived without a reason, {left} "
        f"have later stages before them"
    )
    return bad


def stages_left(row: dict | None, last: str) -> list[str]:
    """Return the stages up to the last one asked for, after those that a mutant has survived."""
    if row is not None and row["outcome"] != "open":
        return []
    first = 0 if row is None else STAGES.index(row["stage"]) + 1
    return list(STAGES[first : STAGES.index(last) + 1])


def opened_bench(limit: float) -> Bench:
    """Return the bench of this checkout; it is made where none is kept, which takes minutes."""
    tops = ("nsbench", "tests", "cases")
    sources = [p for top in tops for p in sorted((ROOT / top).rglob("*.py"))]
    held = [p for p in sources if p.parent != Path(__file__).parent]
    digest = hashlib.sha256(b"".join(p.read_bytes() for p in held)).hexdigest()[:16]
    folder = (journal_path(0).parent / f"bench_{digest}").resolve()
    bench = Bench(folder, limit)
    if (folder / "prepared").exists():
        return bench.opened()
    print("running the tests under coverage: some minutes", flush=True)
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    bench.prepare()
    (folder / "prepared").touch()
    return bench


def try_all(
    benches: list[Bench], todo: list[tuple], path: Path, until: float, done: dict, last: str
) -> dict[str, dict]:
    """Try mutants on several benches at once, up to a time; outcomes are written as they come."""
    found = {}
    queue = iter(todo)
    lock = threading.Lock()

    def work(bench: Bench) -> None:
        while time.monotonic() < until:
            with lock:
                room, file, site = next(queue, (None, None, None))
            if room is None:
                return
            title, fault = changed(file, site)
            line = int(title.removeprefix(fault[0] + ":").partition(":")[0])
            began = time.monotonic()
            row = {"room": room, "title": title, "named": named(file, site)}
            row |= bench.outcome(fault, line, stages_left(done.get(title), last))
            row["seconds"] = round(time.monotonic() - began, 1)
            with lock:
                found[title] = row
                with open(path, "a", encoding="utf-8") as out:
                    out.write(json.dumps(row) + "\n")
                print(f"{row['outcome']}: {title} ({row['by']}) [{row['seconds']} s]", flush=True)

    threads = [threading.Thread(target=work, args=(b,)) for b in benches]
    for t in threads:
        t.start()
    for t in threads:
        t.join()
    return found


def main() -> int:
    """Try the mutants that are left, then report on all."""
    p = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    p.add_argument("--count", type=int, default=500)
    p.add_argument("--seed", type=int, default=1)
    p.add_argument("--rooms", nargs="*", default=list(ROOMS), choices=list(ROOMS))
    p.add_argument("--limit", type=float, default=60.0, help="seconds of the tests of a mutant")
    p.add_argument("--last", default=STAGES[-1], choices=STAGES, help="leave later stages")
    p.add_argument("--minutes", type=float, default=float("inf"), help="begin none after these")
    p.add_argument("--again", action="store_true", help="forget earlier outcomes")
    p.add_argument("-j", "--jobs", type=int, default=1, help="so many mutants at once")
    args = p.parse_args()
    path = journal_path(args.seed)
    path.parent.mkdir(parents=True, exist_ok=True)
    if args.again:
        path.unlink(missing_ok=True)
    done = known(path)
    until = time.monotonic() + 60.0 * args.minutes
    drawn = [m for m in mutants(args.count, args.seed) if m[0] in args.rooms]
    todo = [m for m in drawn if stages_left(done.get(changed(*m[1:])[0]), args.last)]
    bench = opened_bench(args.limit)
    with tempfile.TemporaryDirectory() as scratch:
        benches = [bench.twin(Path(scratch) / str(k)) for k in range(args.jobs)]
        done |= try_all(benches, todo, path, until, done, args.last)
    titles = [changed(*m[1:])[0] for m in drawn]
    results = [done[t] for t in titles if t in done]
    return 1 if report(results, len(drawn)) else 0


if __name__ == "__main__":
    sys.exit(main())
