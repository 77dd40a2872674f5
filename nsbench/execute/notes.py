"""Write the notes of a results folder: cases.json, solvers.json and env.json.

They are written as runs begin, so that a report of a study that was interrupted knows its cases,
methods, machine and command, and once more with the tables.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path

from nsbench.results import consistency
from nsbench.results.atomic_write import write_atomically
from nsbench.results.environment import environment
from nsbench.study import describe


def write_notes(
    out: Path, solvers: Iterable[str], cases: dict, fresh: bool, began: dict | None = None
) -> None:
    """Write the descriptions of the methods, by spec, of the cases, by (case, file), and of the
    machine.

    fresh: there are, or will be, new rows; else an env.json that is as it was written stays.
    began: how and when the runs began (`start_of_runs`), None: not known. Raises StoreError.
    """
    methods = {s: describe.describe_solver(s) for s in dict.fromkeys(solvers)}
    write_atomically(out / "solvers.json", dump(methods))
    described = {key: describe.describe_case(case) for (key, _), case in cases.items()}
    write_atomically(out / "cases.json", dump(described))
    if fresh or not consistency.is_unmodified(out, "env.json"):
        more = {"folder": str(out)} | (began or {})
        write_atomically(out / "env.json", dump(environment(**more)))


def dump(value: object) -> bytes:
    """Return a value as the text of a file of notes."""
    return json.dumps(value, indent=1, default=str).encode()
