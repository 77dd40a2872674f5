"""Environment variables that a user's case or solver file looks up: inputs that no file holds.

Recorded are ``os.environ[...]``, ``in``, ``.get``, ``.setdefault`` and ``os.getenv`` where the code
that asks lies in a user's file; look-ups of libraries are theirs (settings of numerical libraries
are in every key, nsbench.results.run_key). Look-ups while files are loaded enter the run key of
whatever loads or imports that file; those of runs are stored with their rows. A copy of the whole
environment (``dict(os.environ)``, as for a subprocess) is no look-up of each variable in it, and
code in C that calls getenv is not seen.
"""

from __future__ import annotations

import contextlib
import functools
import os
import re
import sys
import threading
from collections.abc import Iterable, Iterator
from pathlib import Path

from nsbench.source_files.locations import is_user_file

# where caches lie, what is printed, and what workers and libraries set themselves (threadpoolctl,
# once imported, lets an OpenMP runtime be loaded twice): no number depends on these
HARMLESS = re.compile(
    r".*(_CACHE_DIR|_NUM_THREADS|_TRACEBACK_FILTERING|_COLOR_SCHEME)$|JAX_PERSISTENT_CACHE_.*|"
    r"NSBENCH_CACHE|NPROC|PYTHONHASHSEED|KMP_DUPLICATE_LIB_OK|"
    r"NUMBA_(DEBUG|DUMP|DEVELOPER|WARNINGS|TRACE|SHOW|FULL|HIGHLIGHT).*"
)
COPIES = ("copy", "items", "values", "__or__", "__ror__", "__repr__", "__eq__")
MAPPING = ("os", "collections.abc", "_collections_abc")  # modules that os.environ is made of
# by file of the code that asks: the value that it got last while files were loaded
_by_load: dict[str, dict[str, str | None]] = {}
# by case or solver file: the first value that its runs got
_by_run: dict[str, dict[str, str | None]] = {}
_loads = [0]  # files that are being loaded now, one within another
_running: list[dict[str, str | None]] = []
_assigned: set[str] = set()  # by a user's code in this process: such a value is no input
_local = threading.local()


@contextlib.contextmanager
def record_look_ups_while_loading() -> Iterator[None]:
    """Record look-ups within, by the user's files whose code makes them."""
    _install()
    _loads[0] += 1
    try:
        yield
    finally:
        _loads[0] -= 1


@contextlib.contextmanager
def record_look_ups_of_run(*paths: str) -> Iterator[None]:
    """Record look-ups within as made by a run of the case and solver files at `paths`."""
    if paths:
        _install()
    before = [*_running]
    _running[:] = [_by_run.setdefault(os.path.realpath(p), {}) for p in paths]
    try:
        yield
    finally:
        _running[:] = before


def looked_up_while_loading(paths: Iterable[str]) -> dict[str, str | None]:
    """Return the variables that code of these files has looked up while files were loaded."""
    return {name: value for p in sorted(paths) for name, value in _by_load.get(p, {}).items()}


def looked_up_by_runs(path: str | Path) -> dict[str, str | None]:
    """Return the variables that runs of a case or solver file have looked up in this process."""
    return dict(_by_run.get(os.path.realpath(path), {}))


def forget_assignments() -> None:
    """Forget which variables a user's code has set: the environment was restored."""
    _assigned.clear()


@functools.cache
def _install() -> None:
    """Have the mapping behind `os.environ` report its look-ups, for as long as the process
    lives."""
    kind = type(os.environ)
    get_item = kind.__getitem__
    set_item = kind.__setitem__
    iterate = kind.__iter__

    def look_up(self: os._Environ, key: str | bytes) -> str | bytes:
        if (_loads[0] or _running) and key is not getattr(_local, "iterated", None):
            _record(self, key, get_item, sys._getframe(1))
        return get_item(self, key)

    def assign(self: os._Environ, key: str | bytes, value: str | bytes) -> None:
        if (_loads[0] or _running) and _asking_file(sys._getframe(1)):
            _assigned.add(os.fsdecode(key))
        set_item(self, key, value)

    def iterated(self: os._Environ) -> Iterator:
        for key in iterate(self):
            _local.iterated = key  # whoever goes through all names asks for none of them
            yield key
        _local.iterated = None

    kind.__getitem__ = look_up
    kind.__setitem__ = assign
    kind.__iter__ = iterated


def _record(environment, key, get_item, frame) -> None:
    file = _asking_file(frame)
    if not file or not isinstance(key, (str, bytes)):
        return
    name = os.fsdecode(key)
    if HARMLESS.match(name) or name in _assigned:
        return
    try:
        value = os.fsdecode(get_item(environment, key))
    except KeyError:
        value = None
    if _loads[0]:
        _by_load.setdefault(file, {})[name] = value
    for looked_up in _running:
        looked_up.setdefault(name, value)


def _asking_file(frame) -> str:
    """Return the user's file whose code asks, methods of the mapping skipped; "" for others."""
    while frame is not None and frame.f_globals.get("__name__") in MAPPING:
        if frame.f_code.co_name in COPIES:
            return ""
        frame = frame.f_back
    file = frame.f_code.co_filename if frame is not None else ""
    if not file.endswith(".py"):  # "<frozen ...>", "<string>"
        return ""
    return _user_file(file)


@functools.lru_cache(maxsize=4096)
def _user_file(file: str) -> str:
    path = os.path.realpath(file)
    return path if is_user_file(path) else ""
