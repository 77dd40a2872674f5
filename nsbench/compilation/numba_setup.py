"""Kernels for numba. What it compiles it keeps on the disk as machine code, with an index in
pickle: reading one runs it.

So a folder that others can write to is no place for it: kernels are then kept in a folder of the
user alone.
"""

import os
import stat
from pathlib import Path

from nsbench.compilation.numba_cache import stamp_all


def private(folder: Path) -> bool:
    """Whether nobody but this user and the system's owner can write to the folder, or make it; True
    where nobody can tell."""
    if not hasattr(os, "getuid"):
        return True
    while not folder.exists():
        folder = folder.parent
    seen = folder.stat()
    return seen.st_uid in (0, os.getuid()) and not stat.S_IMODE(seen.st_mode) & 0o022


def keep_private(home: Path) -> None:
    """Have numba keep kernels elsewhere where others could put theirs in their place. What the user
    has set stays."""
    if os.environ.get("NUMBA_CACHE_DIR") or private(home / "__pycache__"):
        return
    from numba import config

    own = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "nsbench" / "kernels"
    own.mkdir(parents=True, exist_ok=True, mode=0o700)
    if private(own):
        config.CACHE_DIR = str(own)


keep_private(Path(__file__).parent)
stamp_all()
