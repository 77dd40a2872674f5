"""The files of this package and one digest of them all.

A run key holds this digest: whoever edits the package makes every run again. Which parts of the
package a single run reaches is not worked out; what a user edits (case and solver files, modules
and data they use) is, in `user_imports` and `opened_files`.
"""

from __future__ import annotations

import functools
import hashlib

from nsbench.source_files import file_state
from nsbench.source_files.locations import ROOT

# each run depends on its own case and reference alone, which its key names
NOT_EVERY_RUN = ("cases", "reference_solutions")


@functools.cache
def package_files() -> tuple[str, ...]:
    """Return the paths of all Python files of the package, but those of the cases."""
    return tuple(
        str(p)
        for p in sorted(ROOT.rglob("*.py"))
        if p.relative_to(ROOT).parts[0] not in NOT_EVERY_RUN
    )


@functools.cache
def package_digest() -> str:
    """Return the digest of the names and contents of all files of the package, the cases apart."""
    total = hashlib.sha256()
    for path in package_files():
        file_state.record_state(path)
        total.update(f"{path[len(str(ROOT)) :]} {file_state.content_digest(path)}\n".encode())
    return total.hexdigest()


def forget() -> None:
    """Read the files again the next time."""
    package_files.cache_clear()
    package_digest.cache_clear()
