"""Journal of the parts of a study, so that its full form goes on where it was interrupted.

DIR/studies/NAME.parts.jsonl holds one line per finished part: its key, a digest of the sources and
libraries that compute it, and its value as JSON. A line of other sources, or one that was cut off,
is ignored and its part computed again.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable
from functools import cache
from importlib.metadata import version
from pathlib import Path

from nsbench.results.atomic_write import StoreError
from nsbench.source_files.locations import case_files
from nsbench.source_files.package import package_digest
from nsbench.source_files.regular_files import exists, read_text

MAX_JOURNAL_BYTES = 64 << 20
LIBRARIES = ("numpy", "scipy", "numba")
SHARED = "packings"  # the folder of nsbench.studies that all studies compute with
# a study that imports one of them runs methods: its parts depend on the package as a whole
RUN_METHODS = ("nsbench.solvers", "nsbench.studies.runs")


class PartJournal:
    """Computes each part of a study once and remembers its value; path None: for this run alone."""

    def __init__(self, path: Path | None, study: str = ""):
        self.path = path
        self.reused = 0  # parts that were taken from the file
        self._sources = source_digest(study)
        self._values = {} if path is None else _read_parts(path, self._sources)
        self._stored = frozenset(self._values)

    def knows(self, key: str) -> bool:
        """Is the value of this part known?"""
        return key in self._values

    def part(self, key: str, compute: Callable[[], object]) -> object:
        """Return the value of a part: the stored one, or what `compute` returns.

        The value is what JSON makes of it (tuples become lists), stored or not, so that a resumed
        study returns the same numbers. Raises StoreError where it cannot be stored.
        """
        if key in self._values:
            self.reused += key in self._stored
            return self._values[key]
        value = json.loads(json.dumps(compute()))
        self._values[key] = value
        if self.path is not None:
            self._append({"key": key, "sources": self._sources, "value": value})
        return value

    def _append(self, line: dict) -> None:
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with open(self.path, "ab") as file:
                # a line that a killed process left unfinished must not swallow this one
                file.write(b"\n" * _ends_inside_line(self.path))
                file.write(json.dumps(line).encode() + b"\n")
                file.flush()
                os.fsync(file.fileno())
        except OSError as e:
            raise StoreError(f"cannot write {self.path}: {e.strerror}") from None


def _ends_inside_line(path: Path) -> bool:
    with open(path, "rb") as file:
        if file.seek(0, os.SEEK_END) == 0:
            return False
        file.seek(-1, os.SEEK_END)
        return file.read(1) != b"\n"


def _read_parts(path: Path, sources: str) -> dict[str, object]:
    """Read the values of the parts that these sources computed."""
    if not exists(path):
        return {}
    out = {}
    for line in read_text(path, MAX_JOURNAL_BYTES, path.parent).splitlines():
        try:
            entry = json.loads(line)
        except ValueError:
            continue
        if isinstance(entry, dict) and entry.get("sources") == sources:
            out[entry["key"]] = entry["value"]
    return out


@cache
def source_digest(study: str) -> str:
    """Return a digest of the sources of a study and of the versions of its libraries.

    A study that runs methods depends on the package and on the cases; any other on its own folder
    and the shared one.
    """
    digest = hashlib.sha256(" ".join(map(version, LIBRARIES)).encode())
    here = Path(__file__).parent
    own = [
        path.read_bytes()
        for folder in filter(None, (study, SHARED))
        for path in sorted((here / folder).rglob("*.py"))
    ]
    for text in own:
        digest.update(text)
    if any(name.encode() in text for text in own for name in RUN_METHODS):
        digest.update(package_digest().encode())
        for _, path in sorted(case_files().items()):
            digest.update(Path(path).read_bytes())
    return digest.hexdigest()[:16]
