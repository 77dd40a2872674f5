"""Do the tables of a results folder belong to its journal, and are they as they were written?

DIR/.report.key tells: of which rows tables and report were made, how long the journal was then, and
the digests of the files. It is empty while a run is at work that will write other ones, and stays
so if that does not end. Folders without a journal (copies of tables), without the key or with one
of an older version are taken as they are.
"""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

from nsbench.results.atomic_write import StoreError, write_atomically

FILES = ("runs.parquet", "runs.csv", "cases.json", "solvers.json", "extra.json", "env.json")
STAMP = ".report.key"
JOURNAL = "journal.jsonl"


def mark_stale(folder: Path) -> None:
    """From now on until `end` the tables in the folder, if any, are not those of its journal. Works
    on a full disk."""
    stamp = folder / STAMP
    if stamp.exists() or any((folder / name).exists() for name in FILES[:2]):
        try:
            with open(stamp, "wb") as file:
                os.fsync(file.fileno())
        except OSError as e:
            raise StoreError(f"cannot write {stamp}: {e.strerror}") from None


def mark_consistent(folder: Path, rows: str, tables: dict[str, str]) -> None:
    """The files are those of these rows (a digest of them and of what the report is made by).
    tables: digests of the tables that were to be written; StoreError where another one lies there
    now."""
    for name, digest in tables.items():
        if _digest(folder / name) != digest:
            raise StoreError(
                f"{folder / name} is not what was written a moment ago; is its disk sound?"
            )
    lines = [
        rows,
        f"{JOURNAL} {_length(folder)}",
        *(f"{n} {_digest(folder / n)}" for n in FILES if (folder / n).is_file()),
    ]
    write_atomically(folder / STAMP, "\n".join(lines).encode())


def is_consistent(folder: Path, rows: str) -> bool:
    """Are the files there, whole, and of these rows?"""
    told = _told(folder)
    return told[:1] == [rows] and len(told) > 1 and not _wrong(folder, told)


def is_unmodified(folder: Path, name: str) -> bool:
    """Is the file there, and, as far as is known, as it was written?"""
    return (folder / name).is_file() and all(
        line == f"{name} {_digest(folder / name)}"
        for line in _told(folder)
        if line.startswith(f"{name} ")
    )


def check(folder) -> None:
    """Raises ValueError, naming the file, for tables that are not those of the journal beside
    them."""
    folder = Path(folder)
    told = _told(folder)
    if not (folder / JOURNAL).is_file() or not (folder / STAMP).is_file() or len(told) == 1:
        return
    if not told:
        raise ValueError(
            f"the tables in {folder} are older than the last run there, which is going on or did "
            f"not end: run the "
            "same command again"
        )
    if wrong := _wrong(folder, told):
        raise ValueError(f"{wrong}: run the same command again")


def _wrong(folder: Path, told: list[str]) -> str:
    for name, what in (line.rsplit(" ", 1) for line in told[1:]):
        if name == JOURNAL and what != str(_length(folder)):
            return (
                f"the tables in {folder} are not those of its journal, to which a later run "
                f"has written"
            )
        if name != JOURNAL and what != _digest(folder / name):
            return f"{folder / name} is not as it was written"
    return ""


def _told(folder: Path) -> list[str]:
    try:
        return (folder / STAMP).read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return []


def _length(folder: Path) -> int:
    path = folder / JOURNAL
    return path.stat().st_size if path.is_file() else 0


def _digest(path: Path) -> str:
    """Of the content of a file; "" where there is none."""
    if not path.is_file():
        return ""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
