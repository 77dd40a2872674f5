"""numba keeps what it compiled on disk, by the content of the function's own file alone; an edit of
a file that this one imports would go unnoticed, and old code would compute new rows. Here the files
that it imports count too."""

from __future__ import annotations

import functools
import hashlib
from pathlib import Path

from numba.core import caching

from nsbench.source_files import import_graph, locations


@functools.cache
def contents(path: str) -> str:
    """Digest of a file of this package and of all it imports; "" for any other file."""
    if not locations.inside(Path(path).resolve()):
        return ""
    digest = hashlib.sha256()
    for file in sorted(import_graph.dependencies(path).files):
        digest.update(hashlib.sha256(Path(file).read_bytes()).digest())
    return digest.hexdigest()


def stamp_all() -> None:
    """From now on the stamp of what is kept holds the contents of all files."""
    locator = getattr(caching, "_SourceFileBackedLocatorMixin", None)
    if locator is None:  # another numba: it keeps what it keeps
        return
    plain = getattr(locator.get_source_stamp, "plain", locator.get_source_stamp)

    @functools.wraps(plain)
    def stamp(self):
        more = contents(self._py_file)
        return (plain(self), more) if more else plain(self)

    stamp.plain = plain
    locator.get_source_stamp = stamp
