"""Signature and digest of the files that were read, and which of them have changed since.

A process that loads a file later than its run key was computed may load another text than the key
holds. Equal contents prove nothing, since the first text may have been put back; an unchanged
signature (times, size, place on the disk) does.
"""

from __future__ import annotations

import functools
import hashlib
import os
import time
from collections.abc import Iterable
from pathlib import Path

# seconds: file systems with coarse clocks do not show two changes within this time
RECENT = 2.0
CHANGED = "changed meanwhile"
SHORT = 16  # hexadecimal digits of a digest in a run key
_recorded: dict[str, tuple] = {}  # signature, and the digest of a file that was recent then


def record_state(path: str) -> None:
    """Record the signature of a file that is about to be read; only the first call counts."""
    if path not in _recorded:
        signature = stat_signature(path)
        _recorded[path] = signature, ""  # first: reading the file below is recorded as well
        if signature and _recently_modified(signature):
            _recorded[path] = signature, digest(path)


def changed_files(paths: Iterable[str]) -> list[str]:
    """Return the files that may have changed since `record_state`, sorted.

    A file counts as changed if it was never recorded, if its signature differs or, for a file
    that was recent when it was recorded, if its digest differs.
    """
    return sorted(
        p
        for p in paths
        if (recorded := _recorded.get(p)) is None
        or recorded[0] != stat_signature(p)
        or (recorded[1] and recorded[1] != digest(p))
    )


def forget() -> None:
    """Forget all recorded signatures."""
    _recorded.clear()


def stat_signature(path: str) -> tuple[int, ...] | None:
    """Return what every change of a file changes, or None where there is no file.

    The times of its content and of its entry (ns), its size, inode and device: putting an old
    file back changes one of them too.
    """
    try:
        s = os.stat(path)
    except (OSError, ValueError):
        return None
    return s.st_mtime_ns, s.st_ctime_ns, s.st_size, s.st_ino, s.st_dev


def digest(path: str) -> str:
    """Return sixteen hexadecimal digits of a file's content, or why it cannot be read."""
    signature = stat_signature(path)
    if signature is None or _recently_modified(signature):
        return _short_digest(path)
    return _cached_digest(path, signature)


@functools.lru_cache(maxsize=4096)
def _cached_digest(path: str, signature: tuple[int, ...]) -> str:
    return _short_digest(path)


def _short_digest(path: str) -> str:
    try:
        return content_digest(path)[:SHORT]
    except (OSError, ValueError) as e:
        return f"cannot be read: {getattr(e, 'strerror', None) or e}"


def content_digest(path: str | Path) -> str:
    """Return the SHA-256 digest of a file's content. Raises OSError."""
    with open(path, "rb") as f:
        return hashlib.file_digest(f, "sha256").hexdigest()


def _recently_modified(signature: tuple[int, ...]) -> bool:
    return time.time() - max(signature[:2]) / 1e9 < RECENT
