"""Mutants: small faults drawn at random from four rooms, and whether a test or the gate sees them.

    python tests/studies/mutants.py [--count 500] [--seed 1] [--rooms measure gate] [--minutes 60]

Kinds: a changed operator or comparison, a changed constant, a shifted index, a dropped line
(drawn_faults.py). Each mutant lies in a copy of the checkout. It is run against the test files that
import its module, or the nearest module that imports it (imports.py), up to the first failure and
--limit seconds; if it survives, against the suite of gate_suite.py and its baseline. Outcomes are
written to mutants.jsonl in a folder of the user's cache as they come: the same command goes on
where the last one ended, --again starts anew. Prints the counts of each room, and all survivors
with the reason that is known (EQUIVALENT); exit status 1 if there is one without a reason.
"""

import argparse
import json
import os
import random
import subprocess
import sys
import tempfile
import time
from collections import Counter
from itertools import zip_longest
from pathlib import Path

from copies import ROOT, broken_in
from drawn_faults import changed, named, sites_of
from gate_faults import attempt, baseline, baseline_of_one, suite, whole_copy
from imports import imported

ROOMS = {
    "kernels": (
        "nsbench/solvers/**/kernels/*.py",
        "nsbench/dynamics/**/kernels/*.py",
        "nsbench/qp/kernels/*.py",
        "nsbench/linalg/*.py",
        "nsbench/lcp/*.py",
    ),
    "measure": ("nsbench/measure/**/*.py",),
    "gate": ("nsbench/gate/*.py",),
    "journal": (
        "nsbench/results/journal.py",
        "nsbench/results/row_reuse.py",
        "nsbench/results/packed_rows.py",
        "nsbench/results/run_key.py",
        "nsbench/results/tables.py",
        "nsbench/results/consistency.py",
    ),
}
MARKS = ("not long", "long")  # of tests, in the order in which they are tried
SLOWER = 3.0  # times the limit, after which the tests of a mutant are said to hang
# survivors that no test can see, by drawn_faults.named
EQUIVALENT: dict[str, str] = {
    "nsbench/results/consistency.py: "
    'flags |= getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0) -> 1': (
        "the default is taken on systems without these flags alone"
    ),
}


def mutants(rooms, count: int, seed: int) -> list[tuple]:
    """Draw (room, path, site) without repetition: rooms in turn, kinds as likely as each other."""
    rng = random.Random(seed)
    drawn = {}
    for room in rooms:
        files = sorted({p for pattern in ROOMS[room] for p in ROOT.glob(pattern)})
        by_kind: dict[str, list] = {}
        for path in files:
            for kind, sites in sites_of(path).items():
                by_kind.setdefault(kind, []).extend((room, path, s) for s in sites)
        for sites in by_kind.values():
            rng.shuffle(sites)
        drawn[room] = in_turn(by_kind[k] for k in sorted(by_kind))
    return in_turn(drawn.values())[:count]


def in_turn(lists) -> list:
    """Merge lists: the first of each, the second of each, and so on to the end of the longest."""
    turns = zip_longest(*lists)
    return [one for turn in turns for one in turn if one is not None]


def tests_of(file: str) -> list[str]:
    """Return the test files that import a file of the package, or the nearest ones that do so
    through others, and those of the folder that bears the name of its room."""
    tests = [p.relative_to(ROOT).as_posix() for p in sorted((ROOT / "tests").rglob("test_*.py"))]
    sources = [p.relative_to(ROOT).as_posix() for p in sorted((ROOT / "nsbench").rglob("*.py"))]
    level = {file}
    seen = set(level)
    of_room = [t for t in tests if t.split("/")[1] == file.split("/")[1]]
    while level:
        found = [t for t in tests if imported(t) & level]
        if found:
            return list(dict.fromkeys(found + of_room))
        level = {s for s in sources if imported(s) & level} - seen - {"nsbench/__init__.py"}
        seen |= level
    return of_room


def tested(folder: Path, tests: list[tuple], limit: float, kernels=None) -> tuple[str, str]:
    """Run tests in a copy up to the first failure: an outcome, and the test that failed.

    tests: pairs of a file and the marks of those of its tests that are meant (MARKS).
    """
    ends = time.monotonic() + limit
    for marks in MARKS:
        files = [file for file, m in tests if m == marks]
        left = ends - time.monotonic()
        outcome = _tested(folder, files, marks, left, kernels) if files else ("survived", "")
        if outcome[0] != "survived":
            return outcome
    return "survived", ""


def _tested(folder, files, marks, limit, kernels) -> tuple[str, str]:
    env = os.environ | {
        "PYTHONPATH": str(folder),
        "NUMBA_CACHE_DIR": str(kernels or folder / ".kernels"),
        "XDG_CACHE_HOME": str(folder / ".cache"),
    }
    command = [sys.executable, "-m", "pytest", "-xq", "-n0", "-p", "no:cacheprovider"]
    command += ["-m", marks, *files]
    try:
        done = subprocess.run(
            command, cwd=folder, env=env, capture_output=True, text=True, timeout=limit
        )
    except subprocess.TimeoutExpired:
        return "timeout", ""
    lines = [x for x in done.stdout.splitlines() if x.startswith(("FAILED", "ERROR"))]
    return ("survived" if done.returncode == 0 else "killed"), (lines or ["?"])[0][:150]


class Bench:
    """A copy of the checkout with the baseline of its suite, made when it is first needed."""

    def __init__(self, folder: Path, limit: float):
        self.folder = folder
        self.limit = limit
        self.seconds: dict[tuple, float] = {}
        self.baseline: tuple | None = None
        whole_copy(folder)

    def sound_tests(self, file: str) -> list[tuple]:
        """Return the tests of a file (see `tested`) that pass in the unbroken copy, the quick ones
        first.

        Together they take no longer than the limit.
        """
        tests = [(test, marks) for marks in MARKS for test in tests_of(file)]
        for test in tests:
            if test not in self.seconds:
                began = time.monotonic()
                passed = tested(self.folder, [test], self.limit)[0] == "survived"
                self.seconds[test] = time.monotonic() - began if passed else float("inf")
        out = []
        for test in sorted(tests, key=self.seconds.get):
            if self.seconds[test] + sum(self.seconds[t] for t in out) <= self.limit:
                out.append(test)
        return out

    def gate(self, fault) -> bool:
        """Does the gate see the fault?"""
        if self.baseline is None:
            suite(self.folder, "--reference")
            suite(self.folder)
            path = baseline(self.folder)
            self.baseline = path, baseline_of_one(self.folder)
        path, one = self.baseline
        return attempt(self.folder, path, (fault,), one)[0] != 0

    def outcome(self, room: str, fault) -> dict:
        """Try one mutant."""
        tests = self.sound_tests(fault[0])
        with tempfile.TemporaryDirectory() as scratch, broken_in(self.folder, fault):
            kernels = scratch if room == "kernels" else None
            said, by = (
                tested(self.folder, tests, SLOWER * self.limit, kernels)
                if tests
                else ("no tests", "")
            )
        if said in ("survived", "no tests") and self.gate(fault):
            return {"outcome": "gate", "by": f"gate, after: {said}"}
        return {"outcome": said, "by": by, "tests": tests}


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
        if r["outcome"] in ("survived", "no tests"):
            why = EQUIVALENT.get(r["named"], "")
            bad += not why
            print(f"SURVIVED {r['title']}: {why or 'no reason is known'}")
    print(f"{len(results)} of {count} mutants were tried; {bad} survived without a reason")
    return bad


def main() -> int:
    """Try the mutants that are left, then report on all."""
    p = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    p.add_argument("--count", type=int, default=500)
    p.add_argument("--seed", type=int, default=1)
    p.add_argument("--rooms", nargs="*", default=list(ROOMS), choices=list(ROOMS))
    p.add_argument("--limit", type=float, default=300.0, help="seconds of the tests of a mutant")
    p.add_argument("--minutes", type=float, default=float("inf"), help="begin none after these")
    p.add_argument("--again", action="store_true", help="forget earlier outcomes")
    args = p.parse_args()
    path = journal_path(args.seed)
    path.parent.mkdir(parents=True, exist_ok=True)
    if args.again:
        path.unlink(missing_ok=True)
    done = known(path)
    begun = time.monotonic()
    results = []
    with tempfile.TemporaryDirectory() as folder:
        bench = Bench(Path(folder), args.limit)
        for room, file, site in mutants(args.rooms, args.count, args.seed):
            title, fault = changed(file, site)
            if title not in done:
                if time.monotonic() - begun > 60.0 * args.minutes:
                    continue
                found = {"room": room, "title": title, "named": named(file, site)}
                done[title] = found | bench.outcome(room, fault)
                with open(path, "a", encoding="utf-8") as out:
                    out.write(json.dumps(done[title]) + "\n")
                print(f"{done[title]['outcome']}: {title} ({done[title]['by']})", flush=True)
            results.append(done[title])
    return 1 if report(results, args.count) else 0


if __name__ == "__main__":
    sys.exit(main())
