"""Which stored rows may be reused, and under which key a new row is stored.

Keys are computed before the runs, workers load files later, and each worker that replaces another
loads them again. A row is stored under its key only if it is certain what made it: nobody has
changed a file that counts since the key was computed, and the data and environment variables that
the run has read are the same here and now. Otherwise it is shown as unverified, and made again by
the next call.

A row also says of which run it is. One that says of another run than it is stored or sent for is
not kept, whatever its key: a process that a run has forked, say, can answer in the worker's place.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterable
from pathlib import Path

from nsbench.results import journal, run_key
from nsbench.results.journal import Journal, read_journal, settled
from nsbench.results.packed_rows import PackedRows
from nsbench.results.run_key import VARIABLE, Part
from nsbench.source_files import environment_reads, file_state, locations, opened_files
from nsbench.study import Spec
from nsbench.study.attempt import lost_run_row
from nsbench.trajectory import utf8_safe

READ = "read "  # begins the names of items that runs have read; what follows is for `_current`
CHANGED_DURING_RUN = "changed while it ran"
CASE = "case"
ANOTHER_RUN = "The worker sent the row of another run"
# seconds: rows that come within this time are looked at and synced together
TOGETHER = 0.25


def reusable_rows(
    out: Path, specs: list[Spec], keys: dict[Spec, str], timeout: float | None, damaged: list[int]
) -> PackedRows:
    """Return the rows of the journal that need not be made again, by key.

    Left out are rows of another run than their key's, of runs that were killed or had less time
    than `timeout` (s), and of runs that have read what has other contents now. The numbers of
    lines that cannot be read are added to `damaged`.
    """
    rows = PackedRows()
    read_journal(out, damaged, rows)
    spec_of = {keys[s]: s for s in specs}
    stale = {keys[s] for s in changed_data(out, specs, keys)}
    for key in [
        key
        for key, row in rows.items()
        if key in stale
        or not settled(row, timeout)
        or (key in spec_of and row_mismatch(spec_of[key], row))
    ]:
        del rows[key]
    return rows


def row_mismatch(spec: Spec, row: dict) -> str:
    """Return how a row says that it is of another run than the spec; "" if it is of this one."""
    for name in ("case", "solver", "accuracy"):
        expected = utf8_safe(getattr(spec, name))
        if row.get(name) != expected:
            return f"{name} is {str(row.get(name))[:80]}, not {expected[:80]}"
    value = row.get("asked")
    # not by ==: a refused run has no accuracy, NaN
    if not isinstance(value, (int, float)) or repr(float(value)) != repr(float(spec.asked)):
        return f"{spec.accuracy} is {str(value)[:80]}, not {spec.asked!r}"
    return ""


def changed_data(out: Path, specs: list[Spec], keys: dict[Spec, str]) -> dict[Spec, list[str]]:
    """Return what runs have read that is not the same any more, for rows of the journal."""
    data = _data_read(out)
    return {s: names for s in specs if (names := changed_inputs(s, data.get(keys[s], {})))}


def changed_inputs(spec: Spec, read: dict[str, str]) -> list[str]:
    """Return the names of what a run has read and what has other contents here and now."""
    return [name for name, digest in read.items() if _current(spec, name) != digest]


def read_by(spec: Spec) -> dict[str, str]:
    """Return what runs of this process have read, with digests, by names that `changed_inputs`
    takes: files below the folders of the case file and the solver files of the spec, and
    environment variables."""
    files = {CASE: spec.file} if spec.file else {}
    files |= {Path(f).name: f for f in spec.solver_files}
    read = {}
    for who, file in files.items():
        data = opened_files.digests_of_data_read(file, locations.is_user_file)
        variables = environment_reads.looked_up_by_runs(file)
        read |= {f"{who}: {name}": digest for name, digest in data.items()}
        read |= {
            f"{who}: {VARIABLE}{name}": run_key.variable_digest(value)
            for name, value in variables.items()
        }
    return read


def _current(spec: Spec, name: str) -> str:
    """Return the digest that the input of a run has here and now."""
    who, _, what = name.partition(": ")
    if what.startswith(VARIABLE):
        return run_key.variable_digest(os.environ.get(what.removeprefix(VARIABLE)))
    files = [spec.file] if who == CASE else [f for f in spec.solver_files if Path(f).name == who]
    return file_state.digest(str(Path((*files, "")[0]).resolve().parent / what))


def _data_read(out: Path) -> dict[str, dict[str, str]]:
    """Return what runs have read, by key."""
    parts: dict[str, dict[str, str]] = {}
    of_key = {}
    for _, entry in journal.entries(Path(out) / "journal.jsonl"):
        try:
            if "part" in entry:
                items = entry["items"].items()
                parts[entry["part"]] = {
                    k.removeprefix(READ): v for k, v in items if k.startswith(READ)
                }
            else:
                of_key[entry["key"]] = [d for d in entry["parts"] if parts.get(d)]
        except (KeyError, TypeError, AttributeError):
            continue
    return {key: parts[digests[-1]] for key, digests in of_key.items() if digests}


class RowRecorder:
    """Write the rows of one study to its journal, each under its key where it is certain.

    Rows that come within TOGETHER share one look at the files and one sync: a file that is
    unchanged after them was so when they were made. on_this_machine: the rows are made by workers
    that read what lies here; elsewhere a worker itself compares what it reads.
    """

    def __init__(
        self,
        journal: Journal,
        keys: dict[Spec, str],
        parts: dict[Spec, tuple[Part, ...]],
        cases: dict,
        on_this_machine: bool = True,
    ):
        self.journal = journal
        self.keys = keys
        self.parts = parts
        self.cases = cases
        self.on_this_machine = on_this_machine
        self.uncertain: dict[Spec, list[str]] = {}  # and the files that changed
        self.waiting: list[tuple[Spec, dict]] = []
        self.since = 0.0

    def add(self, spec: Spec, row: dict) -> None:
        """Let a row wait for those that come within TOGETHER."""
        if not self.waiting:
            self.since = time.monotonic()
        self.waiting.append((spec, row))

    def write(self, at_once: bool = False) -> list[tuple[Spec, dict]]:
        """Write and sync the rows that wait, if they have waited for TOGETHER or at once.

        Returns the written ones as they are to be shown. Raises StoreError; none waits then.
        """
        if not self.waiting or not (at_once or time.monotonic() - self.since >= TOGETHER):
            return []
        waiting = self.waiting
        self.waiting = []
        watched = {spec: self._watched(spec) for spec, _ in waiting}
        changed = set(file_state.changed_files(set().union(*watched.values())))
        entries = [self._entry(spec, row, changed & watched[spec]) for spec, row in waiting]
        self.journal.append_all(entries)
        return [(spec, entry[1]) for (spec, _), entry in zip(waiting, entries, strict=True)]

    def row(self, spec: Spec, row: dict) -> dict:
        """Write and sync a row; return it as it is to be shown."""
        self.add(spec, row)
        return self.write(at_once=True)[-1][1]

    def _watched(self, spec: Spec) -> set[str]:
        """Return the files of this machine that count for a run."""
        if not self.on_this_machine:
            return set()
        return set(run_key.dependency_files(spec, self.cases[spec.case, spec.file]))

    def _entry(self, spec: Spec, row: dict, files: set[str]) -> tuple[str, dict, tuple[Part, ...]]:
        """Return the journal's entry of a row; files: those that count for it and have changed."""
        read = row.pop("read", None) or {}
        if mismatch := row_mismatch(spec, row):
            sent = row
            row = lost_run_row(spec, "crashed", f"{ANOTHER_RUN}: {mismatch}.")
            row |= {name: sent[name] for name in ("session", "shared") if name in sent}
            read = {}
        changed = [*sorted({Path(f).name for f in files}), *changed_inputs(spec, read)]
        parts = self.parts[spec]
        if not changed:
            more = (Part.of({READ + k: v for k, v in read.items()}),) if read else ()
            return self.keys[spec], row, parts + more
        self.uncertain[spec] = changed
        names = ", ".join(changed)
        if row["status"] in ("ok", "below_reference"):
            row = row | {
                "status": "unverified",
                "why": f"{names} changed while runs were made: with which text this "
                "one was made cannot be told. The next call makes it again.",
            }
        key = f"{CHANGED_DURING_RUN}: {self.keys[spec]}"
        return key, row, (Part.of({CHANGED_DURING_RUN: names}),)

    def report(self, say: Callable[[str], None]) -> None:
        """Say which files changed while runs were made, and how many rows are unverified."""
        if self.uncertain:
            changed = [name for names in self.uncertain.values() for name in names]
            say(
                f"{', '.join(dict.fromkeys(changed))} changed while runs were made: "
                f"{len(self.uncertain)} rows are unverified, the next call makes them again"
            )
