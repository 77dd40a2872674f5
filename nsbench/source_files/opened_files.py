"""Which files a case or solver file opens: data that no import tells of, but that change its
numbers.

What is opened while the file is loaded is known before anything runs; what its runs open is known
after them, and goes with their rows. Seen is what Python opens; a library that opens files in C
code (HDF5, Arrow) is not seen.
"""

from __future__ import annotations

import contextlib
import functools
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

from nsbench.source_files import file_state

_found: dict[str, set[str]] = {}
_open: list[set[str]] = []  # of the files that are being loaded now
_read: dict[
    str, dict[str, tuple | None]
] = {}  # by case or solver file: what runs opened, and its stamp then
_runs: list[dict[str, tuple | None]] = []  # of the files whose run is under way
COMPILED = (".pyc", ".nbi", ".nbc")
WRITTEN = ()  # instead of a stamp: runs have written it themselves, it is no data of theirs


@contextlib.contextmanager
def record_opens_while_loading(path) -> Iterator[None]:
    """Whatever is opened for reading within belongs to the file at `path`."""
    _install()
    _open.append(_found.setdefault(os.path.realpath(path), set()))
    try:
        yield
    finally:
        _open.pop()


@contextlib.contextmanager
def record_opens_of_run(*paths: str) -> Iterator[None]:
    """Whatever is opened for reading within was read by a run of the case and solver files at
    `paths`."""
    if paths:
        _install()
    before = [*_runs]
    _runs[:] = [_read.setdefault(os.path.realpath(p), {}) for p in paths]
    try:
        yield
    finally:
        _runs[:] = before


def opened_while_loading(path) -> frozenset[str]:
    """Real paths of the files that were opened, compiled modules and devices left out."""
    return frozenset(
        p
        for p in _found.get(os.path.realpath(path), ())
        if not p.endswith(".pyc")
        and os.path.isfile(p)
        and not p.startswith(("/proc/", "/sys/", "/dev/"))
    )


def digests_of_data_read(path, counts: Callable[[str], bool]) -> dict[str, str]:
    """Digests of what runs of a case or solver file have read from below its folder, by the path
    from there: all runs of this process, since a later one may use what an earlier one keeps. A
    file that somebody else touched since has none.
    The file itself, and what it opens as it is loaded, are in its key, whether a run was the first
    to load it or not.
    counts(path): is it data, and nothing that is installed?"""
    file = os.path.realpath(path)
    out = {}
    home = os.path.join(os.path.dirname(file), "")
    known = {file, *_found.get(file, ())}
    for p, stamp in _read.get(
        file, {}
    ).items():  # after each run: what libraries opened is told apart first, and cheaply
        if not p.startswith(home) or p in known or stamp == WRITTEN:
            continue
        if not p.endswith(COMPILED) and not os.path.isdir(p) and counts(p):
            out[Path(p).relative_to(home).as_posix()] = (
                file_state.digest(p)
                if stamp == file_state.stat_signature(p)
                else file_state.CHANGED
            )
    return out


@functools.cache
def _install() -> None:
    """An audit hook stays for as long as the process lives, and sees everything that Python
    opens."""

    def hook(event, args):
        if not (_open or _runs) or event not in ("open", "os.rename"):
            return
        path = args[event == "os.rename"]  # os.replace is told by the same name
        if not isinstance(path, (str, bytes)):
            return
        path = os.path.realpath(os.fsdecode(path))
        if event == "os.rename" or _writes(*args[1:]):
            for found in _runs:
                found[path] = WRITTEN
            return
        if _open:
            file_state.record_state(path)
            _open[-1].add(path)
        for found in _runs:
            found.setdefault(path, file_state.stat_signature(path))

    sys.addaudithook(hook)


def _writes(mode=None, flags=0) -> bool:
    return (
        bool(set(str(mode)) & set("wax+"))
        if mode
        else bool((flags or 0) & (os.O_WRONLY | os.O_RDWR))
    )
