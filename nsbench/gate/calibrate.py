"""Calibration: the runs of a study again, from starts 1e-12 apart and with more threads.

What the numbers move by is what rounding alone can do to them; it becomes the tolerances of the
gate (nsbench.gate.baseline).
"""

from __future__ import annotations

import os
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from nsbench import study
from nsbench.execute.workers.pool import run_all
from nsbench.gate import spreads
from nsbench.gate.baseline import line
from nsbench.gate.facts import facts
from nsbench.gate.tolerances import format_tolerances, why_not_held, widest_by_method
from nsbench.report.data import Data, build, columns_of, read
from nsbench.report.style import format_count
from nsbench.results import run_key
from nsbench.results.atomic_write import write_atomically
from nsbench.results.journal import Journal
from nsbench.results.row_reuse import RowRecorder, reusable_rows
from nsbench.study.plan import Spec, resolve

SEEDS = (1, 2)  # of the perturbed starts
THREADS = 2  # of the pass from the unchanged start
FOLDER = "calibration"  # of the journals within the results


@dataclass(frozen=True)
class UserFiles:
    """Files that runs of a study come from: of cases by key, of solvers, and the folder of the
    references of the cases.
    """

    cases: dict[str, str] = field(default_factory=dict)
    solvers: tuple[str, ...] = ()
    references: str = ""


NO_FILES = UserFiles()


def calibrate(folder: Path, args, say, files: UserFiles = NO_FILES) -> int:
    """Make the perturbed passes, write DIR/calibration.csv and say what cannot be held.

    folder: of the results; args: timeout and jobs of the command line; say: prints a line; files:
    of the user's cases and solvers. Returns the exit code. LookupError
    if no run of a known case is there.
    """
    data = read(folder)
    specs = specs_of(data, files)
    if not specs:
        raise LookupError(
            f"{folder} holds no run of a known case: nothing to calibrate (case files are named "
            f"with --cases, or in nsbench.toml)"
        )
    passes = [
        ([replace(s, start_seed=seed) for s in specs], 1, f"starts 1e-12 apart, {seed}")
        for seed in SEEDS
    ]
    passes.append((specs, THREADS, f"{THREADS} threads"))
    others = []
    ended: dict[tuple[str, str], str] = {}
    for number, (these, threads, title) in enumerate(passes, 1):
        say(f"pass {number} of {len(passes)}: {title}, {len(these)} runs")
        again = _again(these, folder / FOLDER / str(number), threads, args, data)
        ended = _ended_otherwise(data, again, title) | ended
        others.append(facts(again))
    first = facts(data)
    found = spreads.spreads(first, others)
    write_atomically(folder / spreads.NAME, spreads.text(found, first).encode())
    lines = {key: line(fact, found[key], "") for key, fact in first.items()}
    loose = [key for key, made in lines.items() if not made.held]
    for sentence in ended.values():
        say(sentence)
    for key in loose:
        if np.isinf(found[key]) and key[:2] in ended:
            continue  # said for all numbers of these runs
        say(f"not to be held: {why_not_held(first[key], lines[key], found[key])}")
    for sentence in format_tolerances(widest_by_method(first, lines)):
        say(sentence)
    say(
        f"{len(first)} numbers, {len(loose)} of them spread too far to be held: "
        f"{folder / spreads.NAME}"
    )
    return 0


def _ended_otherwise(data: Data, again: Data, title: str) -> dict[tuple[str, str], str]:
    """Say of each case and method whose runs of a pass ended otherwise how the first of them did.

    Their numbers cannot be held: what must not matter decides how the run ends.
    """
    said = {}
    for key, runs in again.runs.items():
        # by name: the accuracy of a refused run is NaN, which is no key
        before = dict(zip(map(str, data.runs[key].col["asked"]), data.runs[key].good, strict=True))
        asked = runs.col["asked"]
        changed = [k for k, value in enumerate(asked) if runs.good[k] != before.get(str(value))]
        if changed:
            first = changed[0]
            status = f"{runs.col['status'][first]} {runs.col['why'][first]}".strip()
            said[key] = (
                f"{' '.join(key)}: {format_count(len(changed), 'run')} ended otherwise in the pass "
                f"'{title}', not to be held; the first ({runs.accuracy} = "
                f"{asked[first]:g}): {status}"
            )
    return said


def specs_of(data: Data, files: UserFiles = NO_FILES) -> list[study.Spec]:
    """Collect the runs of a study whose cases are registered or in a file, as specifications."""
    out = []
    for runs in data.runs.values():
        file = files.cases.get(runs.case, "")
        references = files.references if file else ""
        try:
            resolve(runs.case, file, references)
        except LookupError:
            continue
        out += [
            study.Spec(
                runs.case, runs.solver, runs.accuracy, float(a), file, files.solvers, 0, references
            )
            for a in runs.col["asked"]
        ]
    return out


def _again(specs, folder: Path, threads: int, args, data: Data) -> Data:
    """The rows of one pass, journalled like those of a study, so that a pass that was stopped goes
    on."""
    cases = {s.case: resolve(s.case, s.file, s.references) for s in specs}
    run_key.forget()
    parts = {s: run_key.parts_of(s, cases[s.case]) for s in specs}
    found = {s: run_key.key_of(s, parts[s]) for s in specs}
    journal = Journal(folder)
    entries = RowRecorder(journal, found, parts, {(s.case, s.file): cases[s.case] for s in specs})
    rows = reusable_rows(folder, specs, found, args.timeout, [])
    todo = [s for s in specs if found[s] not in rows]
    by_case: dict[str, list] = {}
    for s in todo:
        by_case.setdefault(s.case, []).append(s)

    def on_row(spec: Spec, row: dict) -> None:
        rows[found[spec]] = entries.row(spec, row)

    try:
        jobs = args.jobs or max(
            1, min(2, (os.cpu_count() or 1) // threads)
        )  # no more threads than cores
        run_all([*by_case.values()], jobs, args.timeout, on_row, threads=threads)
    finally:
        journal.close()
    return build(columns_of([rows[found[s]] for s in specs]), data.cases, data.solvers)
