"""Check the type, times, shapes and finiteness of a run's value, right after the run.

Everything after a run relies on these; they are checked before anything else reads the value.
"""

from __future__ import annotations

import sys
from collections.abc import Hashable, Sequence

import numpy as np

from nsbench.case import Case
from nsbench.columns import by_name
from nsbench.trajectory import LAM_TIMES, Status, Trajectory

MAX_STATS = 200  # entries of stats


def returned_violation(case: Case, traj: object) -> str:
    """Return how the value of a run breaks the contract, as a sentence; "" if it keeps it.

    After a failure only the types are checked: what is left of the samples may be anything.
    """
    if not isinstance(traj, Trajectory) or not isinstance(traj.status, Status):
        what = (
            type(traj).__name__
            if not isinstance(traj, Trajectory)
            else f"a status of type {type(traj.status).__name__}"
        )
        if traj is None:
            return (
                "The solver returned NoneType; a Trajectory is needed: is the last line of run(), "
                "`return Trajectory(...)`, missing?"
            )
        return f"The solver returned {what}; a Trajectory with a Status is needed."
    for name, kind, is_right in (
        ("contacts", "tuple", _is_like_a_tuple),
        ("stats", "dict", lambda value: isinstance(value, dict)),
    ):
        found = getattr(traj, name)
        if not is_right(found):
            return (
                f"The solver returned {name} of type {type(found).__name__}; a {kind} is needed."
            )
    if traj.lam_time not in LAM_TIMES:
        return (
            f"The solver returned lam_time = {traj.lam_time!r:.40}; one of "
            f"{', '.join(LAM_TIMES)} is needed."
        )
    if len(traj.stats) > MAX_STATS:
        return (
            f"The solver returned stats with {len(traj.stats)} entries; at most {MAX_STATS} "
            f"become columns."
        )
    if infinite := _infinite_counts(traj.stats):
        return (
            f"The solver returned stats with infinite {', '.join(infinite)}; what is counted is "
            "finite."
        )
    if not traj.status.ok:
        return ""
    if traj.t is not case.t and not np.array_equal(traj.t, case.t):
        return (
            f"The solver says ok, but its {np.size(traj.t)} times are not those of the case, "
            f"{len(case.t)} up to "
            f"{case.t[-1]:g}."
        )
    return _arrays(case, traj)


def _is_like_a_tuple(value: object) -> bool:
    """Is the value a sequence that nothing changes: a tuple, or ids of contacts in an array?"""
    if type(value) is tuple:
        return True
    is_sequence = isinstance(value, Sequence) and not isinstance(value, str | bytes)
    return is_sequence and isinstance(value, Hashable)


def _infinite_counts(stats: dict) -> list[str]:
    """Return the names of counts that no float holds."""
    infinite = []
    columns = by_name()
    for name, value in stats.items():
        if type(value) is int and abs(value) <= sys.maxsize:  # of most counts
            continue
        if name not in columns or columns[name].kind not in ("count", "flag"):
            continue
        if isinstance(value, (int, float, np.floating)) and not abs(value) <= sys.float_info.max:
            infinite += [name] if value == value else []
    return infinite


def _arrays(case: Case, traj: Trajectory) -> str:
    shapes = [("x", (len(case.t), case.n)), ("impulse", (len(case.t), len(traj.contacts)))]
    if np.size(traj.reaction):  # a field with switches has none, and some methods report none
        shapes.append(("reaction", (len(case.t), case.n)))
    for name, shape in shapes:
        a = np.asarray(getattr(traj, name))
        if a.shape != shape or a.dtype != np.float64:
            return (
                f"The solver says ok, but {name} is {a.dtype} of shape {a.shape}; float64 "
                f"{shape} is needed."
            )
        if not np.all(np.isfinite(a)):
            return f"The solver says ok, but {name} is not finite."
    return ""
