"""Journal of a study: DIR/journal.jsonl, one JSON line per run, appended and synced as runs end.

A line holds a row with its key and the digests of the parts of the key, or the items of one part,
which stand before the first row that has it, or keys of the runs that a study plans, which stand
before its rows. Each line ends with a checksum of itself.
"""

from __future__ import annotations

import contextlib
import errno
import json
import math
import os
import re
import stat
import sys
import zlib
from collections.abc import Iterable, Iterator, MutableMapping
from pathlib import Path
from typing import TYPE_CHECKING

from nsbench.results.atomic_write import StoreError, sync_folder
from nsbench.source_files.regular_files import exists, open_regular
from nsbench.trajectory import MACHINE, utf8_safe

if TYPE_CHECKING:
    from nsbench.results.run_key import Part

SCHEMA = 1
BLOCK = 1 << 20  # bytes that are read at a time
MAX_BYTES = 16 << 30  # of a journal: ten million rows take less
LONGEST = 16 << 20  # bytes of a line: the parts of one key take some ten thousand
PLANNED = 100_000  # keys in a line of a plan: it stays shorter than LONGEST
PIECES = re.compile(rb"[^\0\n]+|\0+|\n")
INT64 = 1 << 63  # whole numbers of a table are below this
FOLDERS = ("figures", "output", "studies")
# temporary files that a killed process leaves of `atomic_write.replace` (with its process number),
# and that older versions left of reports and figures: only names that a study writes, in its folder
# and in those below, so that no other file is ever deleted
WRITTEN = (
    r"runs\.csv|runs\.parquet|(?:cases|solvers|extra|env)\.json|report\.html|report\.md|"
    r"\.report\.key|calibration\.csv"
)
LEFT = re.compile(rf"\.(?:(?:{WRITTEN}|report\.key)\.(\d+)|report\.(?:html|md)\.[a-z0-9_]{{8}})")
LEFT_BELOW = re.compile(r"\.(?:.+\.(?:svg|txt|json|html)|.{40})\.(?:(\d+)|[a-z0-9_]{8})")
FULL = (
    errno.ENOSPC,
    errno.EDQUOT,
    errno.EIO,
    errno.EMFILE,
    errno.ENFILE,
)  # the machine's fault, not the folder's


def clean(row: dict) -> dict:
    """Return the row with values that JSON can hold.

    Values become plain Python's, text valid UTF-8, whole numbers beyond 64 bits floats. JSON has no
    NaN and no infinity: they become None and text.
    """
    out = {}
    for k, v in row.items():
        v = v.item() if hasattr(v, "item") else v
        if isinstance(v, int) and not -INT64 <= v < INT64:
            v = float(v) if abs(v) <= sys.float_info.max else math.inf if v > 0 else -math.inf
        if isinstance(v, float) and not math.isfinite(v):
            v = None if math.isnan(v) else ("inf" if v > 0 else "-inf")
        out[utf8_safe(k)] = utf8_safe(v) if isinstance(v, str) else v
    return out


def restore(row: dict) -> dict:
    """Return the row whose cleaned form (`clean`) this is. Raises ValueError for a whole number
    that no cleaned form has."""
    numbers = {"inf": math.inf, "-inf": -math.inf}
    for k, v in row.items():
        if isinstance(v, int) and not -INT64 <= v < INT64:
            raise ValueError(f"{k} is beyond 64 bits")
    return {
        utf8_safe(k): math.nan
        if v is None
        else numbers.get(v, utf8_safe(v))
        if isinstance(v, str)
        else v
        for k, v in row.items()
    }


class Journal:
    """DIR/journal.jsonl, open for appending; locked for other processes while it is open.

    What a kill, a full disk or a loss of power left of a line is dropped on reading and cut off
    here. Raises ValueError for a folder that cannot hold a journal, StoreError for one in use.
    """

    def __init__(self, folder: Path):
        self.path = folder / "journal.jsonl"
        self._parts_written = set()
        made = not folder.exists()
        try:
            folder.mkdir(parents=True, exist_ok=True)
            # not through a link, and without waiting for the other end of what is no file
            self._file = os.open(
                self.path,
                os.O_RDWR
                | os.O_CREAT
                | os.O_APPEND
                | getattr(os, "O_NOFOLLOW", 0)
                | getattr(os, "O_NONBLOCK", 0),
                0o666,
            )
        except OSError as e:
            if e.errno in FULL:
                raise StoreError(f"cannot write to {folder}: {e.strerror}") from None
            if self.path.is_symlink():
                raise ValueError(f"{self.path} is a link; a file of its own is needed") from None
            raise ValueError(f"cannot write to {folder}: {e.strerror}") from None
        try:
            if not stat.S_ISREG(os.fstat(self._file).st_mode):
                raise ValueError(f"{self.path} is no plain file")
            self._lock()
            self._mend()
            for place in (folder, *([folder.parent] if made else [])):
                sync_folder(place)
        except BaseException:
            os.close(self._file)
            raise

    def _lock(self):
        with contextlib.suppress(ImportError):
            import fcntl

            try:
                fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                raise StoreError(f"another run is writing to {self.path.parent}") from None

    def _mend(self):
        """Cut off an incomplete last line, and delete temporary files of killed processes."""
        size = os.fstat(self._file).st_size
        with open(self.path, "rb") as file:
            last = _backwards(file, size, lambda block: block.rfind(b"\n") + 1)
            whole = _backwards(file, last, lambda block: len(block.rstrip(b"\0\n")))
            file.seek(whole)
            ended = whole == 0 or file.read(1) == b"\n"
        whole += whole > 0 and ended
        if whole < size:
            os.ftruncate(self._file, whole)
            if not ended:  # zeros stand where the line ended: the next one is not part of it
                os.write(self._file, b"\n")
            os.fsync(self._file)
        folder = self.path.parent
        for place, names in ((folder, LEFT), *((folder / name, LEFT_BELOW) for name in FOLDERS)):
            for left in place.glob(".*"):  # of a process that was killed while it wrote a file
                writer = names.fullmatch(left.name)
                if writer and left.is_file() and not (writer[1] and _alive(int(writer[1]))):
                    left.unlink(missing_ok=True)

    def append(self, key: str, row: dict, parts: tuple[Part, ...] = ()) -> None:
        """Append and sync the row of a run with the digests of the parts of its key."""
        self.append_all([(key, row, parts)])

    def append_all(self, entries: list[tuple[str, dict, tuple[Part, ...]]]) -> None:
        """Append the rows of some runs, each as (key, row, parts of the key), and sync once.

        The items of a part are written once, before the first such row. Raises StoreError if that
        fails; where the disk was full the whole lines that fitted are kept.
        """
        lines = []
        new: set[str] = set()
        for key, row, parts in entries:
            digests = [p.digest for p in parts]
            for p in parts:
                if p.digest not in self._parts_written | new:
                    lines.append({"schema": SCHEMA, "part": p.digest, "items": dict(p.items)})
                    new.add(p.digest)
            lines.append({"schema": SCHEMA, "key": key, "parts": digests, "row": clean(row)})
        self._write(lines)
        self._parts_written |= new

    def append_plan(self, keys: list[str]) -> None:
        """Append and sync the keys of all runs of a study, the known ones too, as runs begin.

        Raises StoreError if that fails.
        """
        self._write(
            {"schema": SCHEMA, "at": at, "plan": keys[at : at + PLANNED]}
            for at in range(0, len(keys), PLANNED)
        )

    def _write(self, lines: Iterable[dict]) -> None:
        """Append and sync entries. Raises StoreError; whole lines that fitted are kept."""
        size = os.fstat(self._file).st_size
        data = b"".join(map(_sealed, lines))
        written = 0
        try:
            while written < len(data):
                written += os.write(self._file, memoryview(data)[written:])
            os.fsync(self._file)
        except OSError as e:
            with contextlib.suppress(OSError):
                # lines that were not synced are not stored for certain
                whole = data.rfind(b"\n", 0, written) + 1 if written < len(data) else 0
                os.ftruncate(self._file, size + whole)
                os.fsync(self._file)
            raise StoreError(
                f"cannot write {self.path}: {e.strerror}; what was finished before is kept"
            ) from None

    def close(self) -> None:
        """Close the file and release its lock."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1


def _alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):  # there, and of another user
        pass
    return True


def _sealed(entry: dict) -> bytes:
    """Return the line of an entry, with a checksum of what stands before it."""
    text = json.dumps(entry, allow_nan=False).encode()
    return text[:-1] + b', "sum": "%08x"}\n' % zlib.crc32(text[:-1])


def _opened(line: bytes) -> dict:
    """Return the entry of a line. Raises ValueError for one that is not as it was written."""
    entry = json.loads(line)
    if not isinstance(entry, dict):
        raise ValueError("no entry")
    if "sum" in entry:  # journals of older versions have none
        end = line.rfind(b', "sum": ')
        if entry["sum"] != f"{zlib.crc32(line[:end]):08x}":
            raise ValueError("the checksum differs")
    return entry


def _backwards(file, end: int, find) -> int:
    """Return the position before `end` that find(block) returns, read block by block backwards.

    find counts from the begin of the block; 0 if it returns 0 for all blocks.
    """
    while end > 0:
        begin = max(0, end - BLOCK)
        file.seek(begin)
        if at := find(file.read(end - begin)):
            return begin + at
        end = begin
    return 0


def _lines(path: Path):
    """Yield (number from 1, bytes) of the lines of a file, read a block at a time.

    Blocks of zeros, which a loss of power leaves, end the line that they are in. Raises ValueError
    for a line that is longer than any of a journal, and for what is no regular file in its folder.
    """
    number = 1
    line = b""
    with open_regular(path, MAX_BYTES, path.parent) as file:
        while block := file.read(BLOCK):
            for part in PIECES.findall(block):
                if part[:1] not in b"\0\n":
                    line += part
                    if len(line) > LONGEST:
                        raise ValueError(
                            f"line {number} of {path} is longer than {LONGEST} bytes; no journal "
                            f"has such a line"
                        )
                    continue
                if line:
                    yield number, line
                line = b""
                number = number + (part == b"\n")
    if line:
        yield number, line


def entries(path: Path) -> Iterator[tuple[int, dict | None]]:
    """Yield (number of the line from 1, entry, or None where it cannot be read) of a journal."""
    if not exists(path):
        return
    for number, text in _lines(path):
        line = text.strip()
        if line:
            try:
                entry = _opened(line)
            except (ValueError, RecursionError):
                entry = None
            yield number, entry


def read_journal(
    folder: Path, damaged: list[int] | None = None, into: MutableMapping | None = None
) -> MutableMapping:
    """Return rows by key (in `into`, a dict if None); the last row of a key counts.

    Lines that cannot be read are dropped, and their numbers added to `damaged`.
    """
    out: MutableMapping = {} if into is None else into
    unreadable = [] if damaged is None else damaged
    for number, entry in entries(Path(folder) / "journal.jsonl"):
        try:
            if entry["schema"] == SCHEMA and not entry.keys() & {"part", "plan"}:
                out[entry["key"]] = restore(entry["row"])
        except (KeyError, TypeError, AttributeError, ValueError):
            unreadable.append(number)
    return out


def read_plan(folder: Path) -> list[str]:
    """Return the keys of the runs that the last study planned; none where no plan is stored."""
    keys: list[str] = []
    for _, entry in entries(Path(folder) / "journal.jsonl"):
        with contextlib.suppress(KeyError, TypeError, AttributeError):
            if entry["schema"] == SCHEMA and "plan" in entry:
                keys = keys[: int(entry["at"])] + list(map(str, entry["plan"]))
    return keys


def read_parts(folder: Path) -> tuple[dict[tuple, list[str]], dict[str, dict]]:
    """Return (digests of parts by (case, solver, accuracy, asked), items of a part by its digest).

    Of several rows of one run the last counts.
    """
    digests = {}
    parts = {}
    for _, entry in entries(Path(folder) / "journal.jsonl"):
        with contextlib.suppress(ValueError, KeyError, TypeError):
            if entry["schema"] != SCHEMA:
                continue
            if "part" in entry:
                parts[str(entry["part"])] = dict(entry["items"])
            else:
                row = restore(entry["row"])
                digests[row["case"], row["solver"], row["accuracy"], repr(float(row["asked"]))] = (
                    list(entry.get("parts", ()))
                )
    return digests, parts


def as_read(row: dict) -> dict:
    """Return the row as a journal returns it, so that tables are the same before and after a
    resume."""
    return restore(json.loads(json.dumps(clean(row), allow_nan=False)))


def settled(row: dict, timeout: float | None) -> bool:
    """Is this row final?

    A run is attempted again if it was killed, ran out of memory, met a fault of the machine (a full
    disk, a missing file), or had less time than `timeout` (s).
    """
    if row["status"] == "timeout":
        return timeout is not None and timeout <= row.get("limit", 0.0)
    return row["status"] not in ("crashed", "oom") and not (
        row["status"] == "error" and MACHINE in str(row.get("why", ""))
    )
