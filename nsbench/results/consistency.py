"""Check that the tables of a results folder belong to its journal, and are as they were written.

DIR/.report.key holds a digest of the rows of which tables and report were made, the length of the
journal at that time, and the digests of the files. It is empty while a run is at work that will
write other ones, and stays empty if that run does not end. Folders without a journal (copies of
tables), without the key file or with one of an older version are accepted as they are.
"""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

from nsbench.results.atomic_write import StoreError, write_atomically
from nsbench.source_files.regular_files import exists, open_regular, read_bytes

FILES = ("runs.parquet", "runs.csv", "cases.json", "solvers.json", "extra.json", "env.json")
KEY_FILE = ".report.key"
JOURNAL = "journal.jsonl"
MAX_KEY_BYTES = 1 << 20  # of the key file, which has some lines
MAX_TABLE_BYTES = 2 << 30  # of a table: a million rows take half of it


def mark_stale(folder: Path) -> None:
    """Record that the tables in the folder, if any, are not those of its journal, until
    `mark_consistent`. Works on a full disk. Raises StoreError."""
    key_file = folder / KEY_FILE
    if exists(key_file) or any(exists(folder / name) for name in FILES[:2]):
        # not through a link, and without waiting for the other end of what is no file
        flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC
        flags |= getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
        try:
            number = os.open(key_file, flags, 0o666)
            try:
                os.fsync(number)
            finally:
                os.close(number)
        except OSError as e:
            raise StoreError(f"cannot write {key_file}: {e.strerror}") from None


def mark_consistent(folder: Path, rows: str, tables: dict[str, str]) -> None:
    """Record that the files are those of these rows.

    rows: a digest of the rows and of the code that makes the report; tables: digests of the tables
    as they were to be written, by name. Raises StoreError where another content is there now.
    """
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
    write_atomically(folder / KEY_FILE, "\n".join(lines).encode())


def is_consistent(folder: Path, rows: str) -> bool:
    """Are the files there, whole, and of these rows?"""
    try:
        lines = _key_lines(folder)
        return lines[:1] == [rows] and len(lines) > 1 and not _inconsistency(folder, lines)
    except (OSError, ValueError):  # what cannot be read is written anew
        return False


def is_unmodified(folder: Path, name: str) -> bool:
    """Is the file there, and, as far as is known, as it was written?"""
    try:
        return (folder / name).is_file() and all(
            line == f"{name} {_digest(folder / name)}"
            for line in _key_lines(folder)
            if line.startswith(f"{name} ")
        )
    except (OSError, ValueError):
        return False


def check(folder: str | Path) -> None:
    """Raise ValueError, naming the file, for tables that are not those of the folder's journal."""
    folder = Path(folder)
    if not exists(folder / JOURNAL) or not exists(folder / KEY_FILE):
        return
    lines = _key_lines(folder)
    if len(lines) == 1:
        return
    if not lines:
        raise ValueError(
            f"the tables in {folder} are older than the last run there, which is going on or did "
            f"not end: run the "
            "same command again"
        )
    if inconsistency := _inconsistency(folder, lines):
        raise ValueError(f"{inconsistency}: run the same command again")


def is_unfinished(folder: str | Path) -> bool:
    """Has the last run there not written its tables: is it going on, or did it not end?

    Raises ValueError for a key file that cannot be read.
    """
    folder = Path(folder)
    if not exists(folder / JOURNAL):
        return False
    if not any(exists(folder / name) for name in FILES[:2]):
        return True
    return exists(folder / KEY_FILE) and not _key_lines(folder)


def _inconsistency(folder: Path, lines: list[str]) -> str:
    """Return which file is not as the lines of the key file say; "" if all are."""
    for name, _, what in (line.rpartition(" ") for line in lines[1:]):
        if name == JOURNAL and what != str(_length(folder)):
            return (
                f"the tables in {folder} are not those of its journal, to which a later run "
                f"has written"
            )
        if name != JOURNAL and (name not in FILES or what != _digest(folder / name)):
            return f"{folder / name} is not as it was written"
    return ""


def _key_lines(folder: Path) -> list[str]:
    """Return the lines of the key file, none where there is no such file. Raises ValueError."""
    if not exists(folder / KEY_FILE):
        return []
    data = read_bytes(folder / KEY_FILE, MAX_KEY_BYTES, folder)
    return data.decode("utf-8", "replace").splitlines()


def _length(folder: Path) -> int:
    path = folder / JOURNAL
    return path.stat().st_size if path.is_file() else 0


def _digest(path: Path) -> str:
    """Return the digest of a file's content; "" where there is no file. Raises ValueError."""
    if not exists(path):
        return ""
    with open_regular(path, MAX_TABLE_BYTES, path.parent) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
