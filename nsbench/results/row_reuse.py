"""Under which key the row of a run is kept: its own only if what made it is certain.

Keys are made before the runs, workers load files later, and each that replaces another loads them
again. A row is kept under its key if nobody has touched a file that counts since the key was made,
and if the data that the run has read are the same here and now; otherwise it is shown as
unverified, and made again by the next call.
"""

from __future__ import annotations

from pathlib import Path

from nsbench.results import journal, run_key, tables
from nsbench.results.packed_rows import PackedRows
from nsbench.results.run_key import Part
from nsbench.source_files import file_state, locations, opened_files
from nsbench.study import Spec

READ = "read "  # begins the names of items that runs have read; what follows is for `_place`
TOUCHED = "changed while it ran"
CASE = "case"


def reusable_rows(
    out: Path, specs: list[Spec], found: dict[Spec, str], timeout: float | None, damaged: list[int]
) -> PackedRows:
    """Rows by key that need not be made again: those of the journal, but for what was killed, had
    less time, or has read data that are others now. damaged: the numbers of lines that cannot be
    read are added."""
    rows = PackedRows()
    tables.read_journal(out, damaged, rows)
    stale = {found[s] for s in changed_data(out, specs, found)}
    for key in [
        key for key, row in rows.items() if key in stale or not tables.settled(row, timeout)
    ]:
        del rows[key]
    return rows


def changed_data(out: Path, specs: list[Spec], found: dict[Spec, str]) -> dict[Spec, list[str]]:
    """What runs have read that is not the same any more, for those whose row is in the journal."""
    data = _data(out)
    return {s: files for s in specs if (files := changed_inputs(s, data.get(found[s], {})))}


def changed_inputs(spec: Spec, read: dict[str, str]) -> list[str]:
    """Names of the files that a run has read and that have other contents here and now."""
    return [
        name
        for name, digest in read.items()
        if file_state.digest(str(_place(spec, name))) != digest
    ]


def read_by(spec: Spec) -> dict[str, str]:
    """Digests of what runs of this process have read from below the folders of the case file and
    the solver files of the spec; names as `others` takes them."""
    homes = {CASE: spec.file} if spec.file else {}
    homes |= {Path(f).name: f for f in spec.solver_files}
    return {
        f"{who}: {name}": digest
        for who, file in homes.items()
        for name, digest in opened_files.digests_of_data_read(file, locations.is_user_file).items()
    }


def _place(spec: Spec, name: str) -> Path:
    who, _, path = name.partition(": ")
    home = (
        spec.file
        if who == CASE
        else next((f for f in spec.solver_files if Path(f).name == who), "")
    )
    return Path(home).resolve().parent / path


def _data(out: Path) -> dict[str, dict[str, str]]:
    """What runs have read, by key."""
    parts = {}
    of_key = {}
    for _, entry in journal._entries(Path(out) / "journal.jsonl"):
        try:
            if "part" in entry:
                parts[entry["part"]] = {
                    k.removeprefix(READ): v for k, v in entry["items"].items() if k.startswith(READ)
                }
            else:
                of_key[entry["key"]] = [d for d in entry["parts"] if parts.get(d)]
        except (KeyError, TypeError, AttributeError):
            continue
    return {key: parts[digests[-1]] for key, digests in of_key.items() if digests}


class RowRecorder:
    """The rows of one study on their way into the journal. here: they are made by workers of this
    machine, which read what lies here (elsewhere a worker itself compares what it reads)."""

    def __init__(
        self,
        journal: tables.Journal,
        found: dict[Spec, str],
        parts: dict[Spec, tuple[Part, ...]],
        cases: dict,
        here: bool = True,
    ):
        self.journal = journal
        self.keys = found
        self.parts = parts
        self.cases = cases
        self.here = here
        self.uncertain: dict[Spec, list[str]] = {}  # and the files on account of which

    def row(self, spec: Spec, row: dict) -> dict:
        """The row as it is to be shown; written and synced."""
        read = row.pop("read", None) or {}
        files = self._changed(spec, read)
        parts = self.parts[spec]
        if not files:
            more = (Part.of({READ + k: v for k, v in read.items()}),) if read else ()
            self.journal.append(self.keys[spec], row, parts + more)
            return row
        self.uncertain[spec] = files
        if row["status"] in ("ok", "below_reference"):
            row = row | {
                "status": "unverified",
                "why": f"{', '.join(files)} changed while runs were made: with which text this "
                "one was made cannot be told. The next call makes it again.",
            }
        self.journal.append(
            f"{TOUCHED}: {self.keys[spec]}", row, (Part.of({TOUCHED: ", ".join(files)}),)
        )
        return row

    def _changed(self, spec: Spec, read: dict[str, str]) -> list[str]:
        files = (
            file_state.changed_files(
                run_key.dependency_files(spec, self.cases[spec.case, spec.file])
            )
            if self.here
            else []
        )
        return [*dict.fromkeys(Path(f).name for f in files), *changed_inputs(spec, read)]

    def tell(self, say) -> None:
        if self.uncertain:
            files = ", ".join(
                dict.fromkeys(f for several in self.uncertain.values() for f in several)
            )
            say(
                f"{files} changed while runs were made: {len(self.uncertain)} rows are "
                f"unverified, the next call makes them "
                "again"
            )
