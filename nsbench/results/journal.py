"""The journal of a study, line by line as its runs end, and how files are written so that no half
of one is ever seen."""

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
from collections.abc import MutableMapping
from pathlib import Path

from nsbench.results.atomic_write import StoreError, sync_folder
from nsbench.trajectory import MACHINE, utf8_safe

SCHEMA = 1
BLOCK = 1 << 20  # bytes that are read at a time
LONGEST = 16 << 20  # bytes of a line: what one run is made of takes some ten thousand
PIECES = re.compile(rb"[^\0\n]+|\0+|\n")
WHOLE = 1 << 63
FOLDERS = ("figures", "output")
# what a kill leaves of `replace`, by the number of its process; of older versions, of reports and
# figures: of names that a study writes, in its folder and in those below, and of nothing else, be
# it named as strangely
WRITTEN = r"runs\.csv|runs\.parquet|(?:cases|solvers|extra|env)\.json|report\.html|report\.md|\.report\.key|calibration\.csv"
LEFT = re.compile(rf"\.(?:(?:{WRITTEN}|report\.key)\.(\d+)|report\.(?:html|md)\.[a-z0-9_]{{8}})")
LEFT_BELOW = re.compile(r"\.(?:.+\.(?:svg|txt)|.{40})\.(?:(\d+)|[a-z0-9_]{8})")
FULL = (
    errno.ENOSPC,
    errno.EDQUOT,
    errno.EIO,
    errno.EMFILE,
    errno.ENFILE,
)  # the machine's fault, not the folder's


def clean(row: dict) -> dict:
    """The row with plain Python values, text that UTF-8 can spell and whole numbers that 64 bits
    hold; JSON has no NaN and no infinity: they become None and text."""
    out = {}
    for k, v in row.items():
        v = v.item() if hasattr(v, "item") else v
        if isinstance(v, int) and not -WHOLE <= v < WHOLE:
            v = float(v) if abs(v) <= sys.float_info.max else math.inf if v > 0 else -math.inf
        if isinstance(v, float) and not math.isfinite(v):
            v = None if math.isnan(v) else ("inf" if v > 0 else "-inf")
        out[utf8_safe(k)] = utf8_safe(v) if isinstance(v, str) else v
    return out


def restore(row: dict) -> dict:
    numbers = {"inf": math.inf, "-inf": -math.inf}
    return {
        utf8_safe(k): math.nan
        if v is None
        else numbers.get(v, utf8_safe(v))
        if isinstance(v, str)
        else v
        for k, v in row.items()
    }


class Journal:
    """DIR/journal.jsonl: one line per run, written and synced as the run ends; locked while it is
    open.

    Each line carries a checksum of itself. What a kill, a full disk or a loss of power left of a
    line is dropped on reading and cut off here. Raises ValueError for a folder that cannot be one,
    StoreError for one that is in use.
    """

    def __init__(self, folder: Path):
        self.path = folder / "journal.jsonl"
        self._told = set()
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
        """Cut off what is no whole line at the end."""
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

    def append(self, key: str, row: dict, parts=()) -> None:
        """The row of a run, written and synced, and, by their digests, the parts of its key; what
        is in a part is written once, before. Raises StoreError if that fails; the journal is then
        as it was."""
        lines = [
            {"schema": SCHEMA, "part": p.digest, "items": dict(p.items)}
            for p in parts
            if p.digest not in self._told
        ]
        lines.append(
            {"schema": SCHEMA, "key": key, "parts": [p.digest for p in parts], "row": clean(row)}
        )
        size = os.fstat(self._file).st_size
        try:
            left = memoryview(b"".join(map(_sealed, lines)))
            while left:
                left = left[os.write(self._file, left) :]
            os.fsync(self._file)
        except OSError as e:
            with contextlib.suppress(OSError):
                os.ftruncate(self._file, size)
            raise StoreError(
                f"cannot write {self.path}: {e.strerror}; what was finished before is kept"
            ) from None
        self._told |= {p.digest for p in parts}

    def close(self):
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
    """The line of an entry, with a checksum of what stands before it."""
    text = json.dumps(entry, allow_nan=False).encode()
    return text[:-1] + b', "sum": "%08x"}\n' % zlib.crc32(text[:-1])


def _opened(line: bytes) -> dict:
    """The entry of a line. Raises ValueError for one that is not as it was written."""
    entry = json.loads(line)
    if not isinstance(entry, dict):
        raise ValueError("no entry")
    if "sum" in entry:  # journals of older versions have none
        end = line.rfind(b', "sum": ')
        if entry["sum"] != f"{zlib.crc32(line[:end]):08x}":
            raise ValueError("the checksum differs")
    return entry


def _backwards(file, end: int, find) -> int:
    """The place before `end` that find(block) tells of, counted from the block's begin; 0 if it
    tells 0 of all blocks."""
    while end > 0:
        begin = max(0, end - BLOCK)
        file.seek(begin)
        if at := find(file.read(end - begin)):
            return begin + at
        end = begin
    return 0


def _lines(path: Path):
    """(number from 1, bytes) of the lines of a file, a block at a time; blocks of zeros, which a
    loss of power leaves, end the line that they are in. Raises ValueError for a line that is longer
    than any of a journal."""
    number = 1
    line = b""
    with open(path, "rb") as file:
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


def entries(path: Path):
    """(number of its line from 1, entry or None for what cannot be read)."""
    if not path.exists():
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
    """Rows by key (in `into`, a dict if None); the last one of a key counts. Lines that cannot be
    read are dropped, and their numbers added to `damaged`."""
    out: MutableMapping = {} if into is None else into
    lost = [] if damaged is None else damaged
    for number, entry in entries(Path(folder) / "journal.jsonl"):
        try:
            if entry["schema"] == SCHEMA and "part" not in entry:
                out[entry["key"]] = restore(entry["row"])
        except (KeyError, TypeError, AttributeError):
            lost.append(number)
    return out


def read_parts(folder: Path) -> tuple[dict[tuple, list[str]], dict[str, dict]]:
    """What runs were made of: digests of parts by (case, solver, accuracy, asked), the last run
    counting; items of a part by its digest."""
    made = {}
    parts = {}
    for _, entry in entries(Path(folder) / "journal.jsonl"):
        with contextlib.suppress(ValueError, KeyError, TypeError):
            if entry["schema"] != SCHEMA:
                continue
            if "part" in entry:
                parts[str(entry["part"])] = dict(entry["items"])
            else:
                row = restore(entry["row"])
                made[row["case"], row["solver"], row["accuracy"], repr(float(row["asked"]))] = list(
                    entry.get("parts", ())
                )
    return made, parts


def as_read(row: dict) -> dict:
    """The row as a journal gives it back: what is written from it is the same before and after a
    resume."""
    return restore(json.loads(json.dumps(clean(row), allow_nan=False)))


def settled(row: dict, timeout: float | None) -> bool:
    """Is this row final? A run that was killed (by whomever), ran out of memory, met a fault of the
    machine (a full disk, a missing file), or had less time than `timeout` seconds is tried
    again."""
    if row["status"] == "timeout":
        return timeout is not None and timeout <= row.get("limit", 0.0)
    return row["status"] not in ("crashed", "oom") and not (
        row["status"] == "error" and MACHINE in str(row.get("why", ""))
    )
