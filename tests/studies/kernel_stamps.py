"""Stamps of compiled kernels in a copy of the checkout: an edit of a file compiles its users alone.

The package compiles all kernels anew when any of their files changes. In a copy that is broken in
one file at a time most of them are as they were: here only those that import the broken file,
themselves or through others, get another stamp.
"""

import contextlib
import json
import shutil
from pathlib import Path

from imports import reached

SOURCE = "nsbench/compilation/numba_cache.py"
PLAIN = "return (plain(self), kernel_digest()) if ours else plain(self)"
BY_USE = "return (plain(self), _edit_of(self._py_file)) if ours else plain(self)"
READ = '''

@functools.cache
def _edit_of(file: str) -> str:
    """Return the name of the edit that a kernel of this file holds; "" where it holds none."""
    import json

    edit = json.loads((ROOT.parent / "edit.json").read_text(encoding="utf-8"))
    held = Path(file).resolve().relative_to(ROOT.parent).as_posix() in edit["users"]
    return edit["name"] if held else ""


store_privately()
install_cache_stamps()'''


def install(folder: Path) -> None:
    """Have the kernels of a copy stamped so."""
    path = folder / SOURCE
    text = path.read_text(encoding="utf-8")
    assert PLAIN in text
    head, tail = text.replace(PLAIN, BY_USE).split("\n\nstore_privately()\ninstall_cache_stamps()")
    path.write_text(head + READ + tail, encoding="utf-8")
    _write(folder, "", [])


@contextlib.contextmanager
def mutated(folder: Path, file: str):
    """For the time of a with-block, the kernels that hold the code of a file have another stamp."""
    kernels = {p.relative_to(folder).as_posix() for p in (folder / "nsbench").rglob("*.py")}
    users = [k for k in kernels if k == file or file in reached(k, folder)]
    _write(folder, f"edit of {file}", users)
    try:
        yield
    finally:
        _write(folder, "", [])


def _write(folder: Path, name: str, users: list[str]) -> None:
    edit = {"name": name, "users": users}
    (folder / "edit.json").write_text(json.dumps(edit), encoding="utf-8")


def rename_stores(store: Path, before: Path, after: Path) -> None:
    """Give the kernels of one checkout to another, whose files numba knows by their folders."""
    from numba.core.caching import _CacheLocator

    for place in {p.parent for p in (before / "nsbench").rglob("*.py")}:
        moved = after / place.relative_to(before)
        old = _CacheLocator.get_suitable_cache_subpath(str(place / "x.py"))
        new = _CacheLocator.get_suitable_cache_subpath(str(moved / "x.py"))
        if (store / old).is_dir():
            shutil.move(store / old, store / new)
