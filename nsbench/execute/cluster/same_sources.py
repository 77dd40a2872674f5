"""Is what a process far from who asked computes made of the same files, libraries and settings?

The client sends with each run the digests of the parts of its key; the process that is to make the
run makes these parts anew from what it finds in its own place, before it begins, and looks
afterwards whether anybody touched a file on the way.
"""

from __future__ import annotations

from pathlib import Path

from nsbench.results import run_key
from nsbench.source_files import file_state, user_imports
from nsbench.study import Spec
from nsbench.study.attempt import load_case_and_solver

_same: set[tuple] = set()  # what was compared and found to be alike


def source_mismatch(spec: Spec) -> dict[str, str]:
    """{} if a run would be made of what the client has; else the items it is made of here, or under
    "why" what to say."""
    which = spec.case, spec.file, spec.solver, spec.solver_files, spec.parts
    if not spec.parts or which in _same:
        return {}
    # records the state of the files before they are loaded
    user_imports.dependencies(*filter(None, [spec.file, *spec.solver_files]))
    try:
        case, _ = load_case_and_solver(spec)
    except Exception as e:  # it was loaded where it was asked for
        return {"why": f"{type(e).__name__}: {e}"}
    parts = run_key.parts_of(spec, case)
    if tuple(p.digest for p in parts) != spec.parts:
        return dict(item for p in parts for item in p.items)
    _same.add(which)
    return {}


def touched(spec: Spec) -> dict[str, str]:
    """Says under "why" which files are not, or may not be, what they were when the run began."""
    if not spec.parts:
        return {}
    files = [
        Path(f).name
        for f in file_state.changed_files(
            run_key.dependency_files(spec, load_case_and_solver(spec)[0])
        )
    ]
    return {"why": f"{', '.join(files)} changed there while it was used"} if files else {}
