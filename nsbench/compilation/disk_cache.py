"""Machine code in files of the user's cache folder: who may write there, and whether a file is
whole.

NSBENCH_CACHE=off keeps everything off the disk. A file that cannot be read or written is no error:
what it would hold is compiled again.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
import tempfile
from pathlib import Path

FILES = 2000  # kept in one folder, about 300 MB of JAX programs; the oldest give way


@functools.cache
def cache_folder(kind: str) -> Path | None:
    """Where machine code of a kind is kept, or None: not wanted, or nowhere to write."""
    if os.environ.get("NSBENCH_CACHE", "").lower() == "off":
        return None
    path = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "nsbench" / kind
    try:
        path.mkdir(parents=True, exist_ok=True, mode=0o700)
    except OSError:
        return None
    # it is run as it stands: a folder that others can write to is not read
    return (
        path
        if not hasattr(os, "getuid")
        or (path.stat().st_uid == os.getuid() and not path.stat().st_mode & 0o022)
        else None
    )


def digest(*words: str) -> str:
    """The name of a file, from all that makes its content what it is."""
    h = hashlib.sha256()
    for w in words:
        h.update(len(w).to_bytes(8, "little") + w.encode())
    return h.hexdigest()


@functools.cache
def processor() -> str:
    """The machine that the code is for, and this Python."""
    import platform

    lines = ""
    with contextlib.suppress(OSError):
        lines = "".join(
            sorted(
                set(
                    line
                    for line in Path("/proc/cpuinfo").read_text().splitlines()
                    if line.startswith(("flags", "Features", "model name"))
                )
            )
        )
    return (
        f"{platform.machine()} {platform.processor()} {platform.python_version()} "
        f"{os.cpu_count()} {lines}"
    )


def read(home: Path | None, name: str | None) -> bytes | None:
    """What was written under the name; None where that is nothing, or half a file."""
    if home is None or name is None:
        return None
    try:
        data = (home / f"{name}.bin").read_bytes()
    except OSError:
        return None
    return data[32:] if hashlib.sha256(data[32:]).digest() == data[:32] else None


def write(home: Path | None, name: str | None, body: bytes) -> None:
    """Keep it, in one piece or not at all; where that fails (a full disk, a folder that is gone)
    only time is lost."""
    if home is None or name is None:
        return
    with contextlib.suppress(OSError):
        with tempfile.NamedTemporaryFile(dir=home, delete=False) as f:
            f.write(hashlib.sha256(body).digest() + body)
        os.replace(f.name, home / f"{name}.bin")
        files = sorted(home.glob("*.bin"), key=lambda p: p.stat().st_mtime)
        for old in files[:-FILES]:
            old.unlink(missing_ok=True)


def remove(home: Path | None, name: str) -> None:
    """The file is of no use."""
    if home is not None:
        with contextlib.suppress(OSError):
            (home / f"{name}.bin").unlink()
