"""Which files a case or solver file opens while it is loaded: data that no import tells of, but that change its numbers."""
from __future__ import annotations

import contextlib
import functools
import os
import sys
from collections.abc import Iterator

_found: dict[str, set[str]] = {}
_open: list[set[str]] = []                # of the files that are being loaded now


@contextlib.contextmanager
def during(path) -> Iterator[None]:
    """Whatever is opened for reading within belongs to the file at `path`."""
    _install()
    _open.append(_found.setdefault(os.path.realpath(path), set()))
    try:
        yield
    finally:
        _open.pop()


def by(path) -> frozenset[str]:
    """Real paths of the files that were opened, compiled modules and devices left out."""
    return frozenset(p for p in _found.get(os.path.realpath(path), ()) if not p.endswith(".pyc") and os.path.isfile(p)
                     and not p.startswith(("/proc/", "/sys/", "/dev/")))


@functools.cache
def _install() -> None:
    """An audit hook stays for as long as the process lives, and sees everything that Python opens."""
    def hook(event, args):
        if event == "open" and _open and isinstance(args[0], (str, bytes)) and not set(str(args[1] or "r")) & set("wax+"):
            _open[-1].add(os.path.realpath(os.fsdecode(args[0])))
    sys.addaudithook(hook)
