"""Where numba stores compiled kernels, and which edits make it compile them again.

numba stores machine code on the disk with an index that is a pickle: loading one runs it. So a
folder to which others can write is no place for it; kernels are then stored in a folder of the user
alone.

It takes a stored kernel to be current by the signature of the kernel's own file. A kernel holds the
code of those it calls and the values of global constants, so that an edit of another file would go
unnoticed, and old code would compute new rows. Here the stamp of every kernel holds one digest of
all kernel files: an edit of any of them compiles all kernels anew.

What it stores has no checksum: nsbench.compilation.kernel_store adds them.

These take effect when this module is imported (by nsbench.compilation.decorators, from which every
kernel takes its decorator): before numba compiles anything.
"""

from __future__ import annotations

import functools
import os
import stat
from pathlib import Path

from numba import config

from nsbench.compilation import (
    announcement,
    disk_cache,
    garbage_collection,
    kernel_store,
    library_functions,
)
from nsbench.source_files import file_state
from nsbench.source_files.kernel_files import kernel_files, stores_of
from nsbench.source_files.locations import ROOT, is_in_package


@functools.cache
def kernel_digest() -> str:
    """Return the digest of the names and contents of all kernel files."""
    return disk_cache.digest_of(
        f"{p.relative_to(ROOT)} {file_state.content_digest(p)}" for p in kernel_files()
    )


def stored_kernel_faults() -> list[str]:
    """Return which files of stored kernels of this package cannot be used, and why."""
    files = {p.parent: p for p in kernel_files()}.values()
    folders = [folder for p in files for folder in stores_of(p, config.CACHE_DIR)]
    return [fault for folder in folders for fault in kernel_store.faults_in(folder)]


def has_private_files(folder: Path) -> bool:
    """Can nobody but this user and the system's owner write to the folder, or create it?

    True where owners are not known; False for a folder that this user may not look at.
    """
    if not hasattr(os, "getuid"):
        return True
    try:
        while not folder.exists():
            folder = folder.parent
        state = folder.stat()
    except OSError:
        return False
    return state.st_uid in (0, os.getuid()) and not (
        stat.S_IMODE(state.st_mode) & disk_cache.OTHERS_WRITE
    )


def store_privately() -> None:
    """Have numba store kernels in the user's own folder where others could replace them.

    A folder that the user has set is left as it is.
    """
    folders = {p.parent for p in kernel_files()}
    if os.environ.get("NUMBA_CACHE_DIR") or all(
        has_private_files(f / "__pycache__") for f in folders
    ):
        return

    own = disk_cache.private_folder("kernels")
    if own is not None and has_private_files(own):
        config.CACHE_DIR = str(own)


def install_cache_stamps() -> None:
    """Add the digest of all kernel files to numba's stamp of every kernel of this package."""
    from numba.core import caching

    locator = getattr(caching, "_SourceFileBackedLocatorMixin", None)
    if locator is None:  # another numba: it stores what it stores
        return
    plain = getattr(locator.get_source_stamp, "plain", locator.get_source_stamp)

    @functools.wraps(plain)
    def stamp(self) -> tuple:
        ours = is_in_package(Path(self._py_file).resolve())
        return (plain(self), kernel_digest()) if ours else plain(self)

    stamp.plain = plain
    locator.get_source_stamp = stamp


store_privately()
install_cache_stamps()
kernel_store.install()
library_functions.install()
garbage_collection.pause_while_compiling()
announcement.listen()
