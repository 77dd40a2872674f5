"""Check that a remote run is made of the files, libraries and settings that the client has.

The client sends with each run the digests of the parts of its key. The remote process computes
these parts again from what it finds, before it begins the run, and checks afterwards that no file
was touched meanwhile.
"""

from __future__ import annotations

from pathlib import Path

from nsbench.results import run_key
from nsbench.source_files import file_state, user_imports
from nsbench.study import Spec
from nsbench.study.attempt import load_case_and_solver

_compared: set[tuple] = set()  # what was compared and is the same


def source_mismatch(spec: Spec) -> dict[str, str]:
    """Compare what a run would be made of here with what the client has.

    Returns {} if that is the same; else the items of here by name, or the reason under "why".
    """
    made_of = spec.case, spec.file, spec.solver, spec.solver_files, spec.parts
    if not spec.parts or made_of in _compared:
        return {}
    # records the state of the files before they are loaded
    user_imports.dependencies(*filter(None, [spec.file, *spec.solver_files]))
    try:
        case, _ = load_case_and_solver(spec)
    except Exception as e:  # the client could load it
        return {"why": f"{type(e).__name__}: {e}"}
    parts = run_key.parts_of(spec, case)
    if tuple(p.digest for p in parts) != spec.parts:
        return dict(item for p in parts for item in p.items)
    _compared.add(made_of)
    return {}


def find_touched_files(spec: Spec) -> dict[str, str]:
    """Name under "why" the files that may have changed since the run began; {} if there are
    none."""
    if not spec.parts:
        return {}
    files = [
        Path(f).name
        for f in file_state.changed_files(
            run_key.dependency_files(spec, load_case_and_solver(spec)[0])
        )
    ]
    return {"why": f"{', '.join(files)} changed there while it was used"} if files else {}
