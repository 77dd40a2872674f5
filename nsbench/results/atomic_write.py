"""Write a file so that no half of it is ever seen: beside its place, synced, then renamed.

Not even a loss of power leaves half a file; on file systems whose folders cannot be synced the new
name may be lost with it.
"""

from __future__ import annotations

import contextlib
import errno
import os
from pathlib import Path


class StoreError(Exception):
    """The results folder cannot be used; the message says which file and why."""


def write_atomically(path: Path, data: bytes) -> None:
    """Write the data with `replace`. Raises StoreError, which names the file, where that fails."""
    try:
        replace(path, data)
    except OSError as e:
        raise StoreError(f"cannot write {path}: {e.strerror}") from None


def replace(path: Path, data: bytes) -> None:
    """Write the data to a hidden file of this process in the same folder, sync it and rename it.

    Raises OSError; nothing is left then.
    """
    if not path.parent.is_dir():
        raise FileNotFoundError(errno.ENOENT, "there is no such folder", str(path.parent))
    temporary = path.with_name(f".{path.name[:40]}.{os.getpid()}")
    try:
        with open(temporary, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
        sync_folder(path.parent)
    except BaseException:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)
        raise


def sync_folder(folder: Path) -> None:
    """Sync the names in a folder, so that a new one outlasts a loss of power, where that can be
    done."""
    with contextlib.suppress(OSError):
        number = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(number)
        finally:
            os.close(number)
