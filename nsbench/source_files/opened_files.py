"""Files that a user's case or solver file opens: data and modules that no import statement names.

They change its numbers all the same.

What is opened while the file is loaded is known before anything runs, and enters its run key; what
its runs open is known after them, and is stored with their rows. An audit hook sees everything that
Python opens; a library that opens files in C code (HDF5, Arrow) does not raise the event.

A module whose byte code is cached is never opened itself: Python reads ``__pycache__/NAME.pyc``.
The source that belongs to it is recorded in its place: a key does not depend on that cache.
"""

from __future__ import annotations

import contextlib
import functools
import importlib.util
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

from nsbench.source_files import environment_reads, file_state

# by case or solver file: what was opened while it was loaded
_opened_by_load: dict[str, set[str]] = {}
_loading: list[set[str]] = []  # entries of `_opened_by_load` whose files are being loaded now
# by case or solver file: what its runs opened, with the signature at that time
_opened_by_run: dict[str, dict[str, tuple | None]] = {}
_running: list[dict[str, tuple | None]] = []  # entries of `_opened_by_run` whose run is under way
MACHINE_CODE = (".nbi", ".nbc")  # numba's cache
DEVICES = ("/proc/", "/sys/", "/dev/")
WRITTEN = ()  # instead of a signature: a run has written the file itself, it is no input


@contextlib.contextmanager
def record_opens_while_loading(path: str | Path) -> Iterator[None]:
    """Record what is opened for reading within as used by the file at `path`; environment variables
    that are looked up are recorded too (nsbench.source_files.environment_reads)."""
    _install_hook()
    _loading.append(_opened_by_load.setdefault(os.path.realpath(path), set()))
    try:
        with environment_reads.record_look_ups_while_loading():
            yield
    finally:
        _loading.pop()


@contextlib.contextmanager
def record_opens_of_run(*paths: str) -> Iterator[None]:
    """Record what is opened for reading within as read by a run of the case and solver files at
    `paths`; environment variables that are looked up are recorded too."""
    if paths:
        _install_hook()
    before = [*_running]
    _running[:] = [_opened_by_run.setdefault(os.path.realpath(p), {}) for p in paths]
    try:
        with environment_reads.record_look_ups_of_run(*paths):
            yield
    finally:
        _running[:] = before


def opened_while_loading(path: str | Path) -> frozenset[str]:
    """Return the real paths of the files that loading the file at `path` opened, but devices."""
    return frozenset(
        p
        for p in _opened_by_load.get(os.path.realpath(path), ())
        if os.path.isfile(p) and not p.startswith(DEVICES)
    )


def digests_of_data_read(path: str | Path, is_data: Callable[[str], bool]) -> dict[str, str]:
    """Return the digests of what runs of a case or solver file have read from below its folder, by
    the path from there.

    All runs of this process count, since a later one may use what an earlier one stored. A file
    that changed since it was read has `file_state.CHANGED` instead of a digest. The file itself,
    and what loading it opens, are in its run key and not here, whether a run was the first to load
    it or not. is_data(path): is it an input, and nothing that is installed?
    """
    file = os.path.realpath(path)
    folder = os.path.join(os.path.dirname(file), "")
    in_key = {file, *_opened_by_load.get(file, ())}
    digests = {}
    # this is asked after each run: what libraries opened is sorted out first, by cheap tests
    for opened, signature in _opened_by_run.get(file, {}).items():
        if not opened.startswith(folder) or opened in in_key or signature == WRITTEN:
            continue
        if opened.endswith(MACHINE_CODE) or os.path.isdir(opened) or not is_data(opened):
            continue
        same = signature == file_state.stat_signature(opened)
        name = Path(opened).relative_to(folder).as_posix()
        digests[name] = file_state.digest(opened) if same else file_state.CHANGED
    return digests


@functools.cache
def _install_hook() -> None:
    """Add the audit hook, which stays for as long as the process lives."""

    def hook(event: str, args: tuple) -> None:
        if not (_loading or _running) or event not in ("open", "os.rename"):
            return
        path = args[event == "os.rename"]  # os.replace raises the same event
        if not isinstance(path, (str, bytes)):
            return
        path = os.path.realpath(os.fsdecode(path))
        if event == "os.rename" or _writes(*args[1:]):
            for opened in _running:
                opened[path] = WRITTEN
            return
        path = _source_of(path)
        if _loading:
            file_state.record_state(path)
            _loading[-1].add(path)
        for opened in _running:
            opened.setdefault(path, file_state.stat_signature(path))

    sys.addaudithook(hook)


def _source_of(path: str) -> str:
    """Return the source of cached byte code, and any other path as it is.

    A .pyc file without a source is a module of its own.
    """
    if path.endswith(".pyc"):
        with contextlib.suppress(ValueError):
            source = importlib.util.source_from_cache(path)
            return source if os.path.isfile(source) else path
    return path


def _writes(mode=None, flags=0) -> bool:
    if mode:
        return bool(set(str(mode)) & set("wax+"))
    return bool((flags or 0) & (os.O_WRONLY | os.O_RDWR))
