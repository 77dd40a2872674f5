"""Files that were read to know what a run is made of, and whether they have been touched since.

A process that loads a file later than its key was made may load another text than the key holds.
That the text is the same again proves nothing (it may have been put back); that nobody has touched
the file does.
"""

from __future__ import annotations

import functools
import hashlib
import os
import time
from collections.abc import Iterable

YOUNG = 2.0  # seconds: of a file as young as this a clock of the disk may not show another change
CHANGED = "changed meanwhile"
_seen: dict[str, tuple] = {}


def record_state(path: str) -> None:
    """The file is about to be read; the first time counts."""
    if path not in _seen:
        now = stat_signature(path)
        _seen[path] = now, ""  # first: reading the file is noted as well
        if now and _recently_modified(now):
            _seen[path] = now, digest(path)


def changed_files(paths: Iterable[str]) -> list[str]:
    """Those of the files that are not, or may not be, what they were when they were noted;
    sorted."""
    return sorted(
        p
        for p in paths
        if (was := _seen.get(p)) is None
        or was[0] != stat_signature(p)
        or (was[1] and was[1] != digest(p))
    )


def forget() -> None:
    _seen.clear()


def stat_signature(path: str) -> tuple[int, ...] | None:
    """What every change of a file changes, putting an old one back included: times of its text and
    of its entry (ns), size, place on the disk; None where there is none."""
    try:
        s = os.stat(path)
    except (OSError, ValueError):
        return None
    return s.st_mtime_ns, s.st_ctime_ns, s.st_size, s.st_ino, s.st_dev


def digest(path: str) -> str:
    """Sixteen hexadecimal digits of the content of a file, or why there are none."""
    now = stat_signature(path)
    return _digest(path) if now is None or _recently_modified(now) else _kept(path, now)


@functools.lru_cache(maxsize=4096)
def _kept(path: str, now: tuple[int, ...]) -> str:
    return _digest(path)


def _digest(path):
    try:
        with open(path, "rb") as f:
            return hashlib.file_digest(f, "sha256").hexdigest()[:16]
    except (OSError, ValueError) as e:
        return f"cannot be read: {getattr(e, 'strerror', None) or e}"


def _recently_modified(now) -> bool:
    return time.time() - max(now[:2]) / 1e9 < YOUNG
