"""Checksummed files in the user's cache folder, and the SHA-256 helper of the package.

NSBENCH_CACHE=off keeps everything off the disk. A file that cannot be read or written is no error:
what it would hold is computed again.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
import tempfile
from collections.abc import Iterable
from pathlib import Path

from nsbench.source_files.regular_files import read_bytes

FILES = 2000  # in one folder, about 300 MB of JAX programs; the oldest are deleted beyond
MAX_FILE_BYTES = 256 << 20  # a compiled program takes less than a megabyte
CHECKSUM = 32  # bytes before the content of a file
OTHERS_WRITE = 0o022  # permission bits: the group or everybody may write


def user_cache_folder() -> Path:
    """Return the folder below which everything that nsbench caches for this user lies.

    XDG_CACHE_HOME counts on all systems, as documented; without it the folder is the system's.
    """
    if home := os.environ.get("XDG_CACHE_HOME"):
        return Path(home) / "nsbench"
    import platformdirs

    return platformdirs.user_cache_path("nsbench", appauthor=False)


@functools.cache
def cache_folder(kind: str) -> Path | None:
    """Return the folder for machine code of a kind, or None: not wanted, or nowhere to write."""
    if os.environ.get("NSBENCH_CACHE", "").lower() == "off":
        return None
    folder = private_folder(kind)
    # machine code is run as it is: a folder that others can write to is not read
    return folder if folder is not None and is_private(folder) else None


def private_folder(kind: str) -> Path | None:
    """Create the user's folder for a kind of files, for this user alone; None where that fails."""
    folder = user_cache_folder() / kind
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    except OSError:
        return None
    return folder


def is_private(folder: Path) -> bool:
    """Can nobody but this user write to the folder? True where owners are not known."""
    if not hasattr(os, "getuid"):
        return True
    state = folder.stat()
    return state.st_uid == os.getuid() and not state.st_mode & OTHERS_WRITE


def digest(*chunks: str | bytes) -> str:
    """Return the SHA-256 digest of texts and bytes, each with its length: 64 hexadecimal
    digits."""
    return digest_of(chunks)


def digest_of(chunks: Iterable[str | bytes]) -> str:
    """Return the digest of chunks that are taken one by one, never all at once."""
    total = hashlib.sha256()
    for chunk in chunks:
        data = chunk.encode() if isinstance(chunk, str) else chunk
        total.update(len(data).to_bytes(8, "little") + data)
    return total.hexdigest()


def read(folder: Path | None, name: str | None) -> bytes | None:
    """Return what was written under the name; None where that is nothing, or damaged."""
    if folder is None or name is None:
        return None
    try:
        return _checked(folder / f"{name}.bin")
    except (OSError, ValueError):
        return None


def faults_in(folder: Path) -> list[str]:
    """Return why files of a cache folder cannot be used, one sentence each."""
    faults = []
    for path in sorted(folder.glob("*.bin")):
        try:
            _checked(path)
        except (OSError, ValueError) as e:
            faults.append(str(e))
    return faults


def _checked(path: Path) -> bytes:
    """Return what was written to a file. Raises OSError, and ValueError where it is damaged."""
    data = read_bytes(path, MAX_FILE_BYTES)
    body = data[CHECKSUM:]
    if hashlib.sha256(body).digest() != data[:CHECKSUM]:
        raise ValueError(f"{path} is not as its checksum says")
    return body


def write(folder: Path | None, name: str | None, body: bytes) -> None:
    """Write the body in one piece or not at all; where that fails (a full disk, a folder that is
    gone) only time is lost."""
    if folder is None or name is None:
        return
    with contextlib.suppress(OSError):
        with tempfile.NamedTemporaryFile(dir=folder, delete=False) as f:
            f.write(hashlib.sha256(body).digest() + body)
        os.replace(f.name, folder / f"{name}.bin")
        files = sorted(folder.glob("*.bin"), key=lambda p: p.stat().st_mtime)
        for old in files[:-FILES]:
            old.unlink(missing_ok=True)


def remove(folder: Path | None, name: str) -> None:
    """Delete a file that is of no use."""
    if folder is not None:
        with contextlib.suppress(OSError):
            (folder / f"{name}.bin").unlink()
