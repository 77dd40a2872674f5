"""Find the case and solver files that installed packages bring, by their entry points.

    [project.entry-points."nsbench.cases"]        my_tissue = "my_package.my_tissue"
    [project.entry-points."nsbench.solvers"]      my_method = "my_package.my_method"

An entry point names a module, whose file is then a case or solver file like any other: its runs
depend on it, and workers load it. The file bears the name of the entry point. Names are read from
the metadata of installed packages; no module is imported for that.
"""

from __future__ import annotations

import functools
import importlib.util
from importlib import metadata
from pathlib import Path

from nsbench import input_errors, user_code

CASES = "nsbench.cases"
SOLVERS = "nsbench.solvers"


@functools.cache
def _entry_points(group: str) -> dict[str, metadata.EntryPoint]:
    """Return the entry points of a group by name; the first of two that are named alike."""
    found: dict[str, metadata.EntryPoint] = {}
    for point in metadata.entry_points(group=group):
        found.setdefault(point.name, point)
    return found


def plugin_names(group: str) -> list[str]:
    """List the names that installed packages bring, sorted, whether they can be loaded or not."""
    return sorted(_entry_points(group))


def plugin_file(group: str, name: str) -> Path:
    """Return the file of a plugin. The packages around its module are imported to find it.

    Raises LookupError for an unknown name, ValueError with the reason if there is no such file.
    """
    points = _entry_points(group)
    if name not in points:
        raise LookupError(f"no plugin {name!r}; {input_errors.nearest(name, points)}")
    module = points[name].module
    try:
        with user_code.guarded(f"the package of the plugin {name}"):
            spec = importlib.util.find_spec(module)
    except (Exception, SystemExit) as e:  # code of another package: any failure is its own
        why = f"{type(e).__name__}: {e}"
        raise ValueError(f"entry point {name} = {module}: its package fails: {why}") from e
    if spec is None or not spec.origin or not spec.origin.endswith(".py"):
        raise ValueError(f"entry point {name} = {module}: there is no such Python file")
    path = Path(spec.origin)
    if path.stem != name:
        raise ValueError(
            f"entry point {name} = {module}: the file is named {path.name}; {name}.py is needed"
        )
    return path


def forget() -> None:
    """Read the metadata of installed packages again from now on."""
    _entry_points.cache_clear()
