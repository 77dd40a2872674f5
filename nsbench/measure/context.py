"""Context of the measures of a case: reference, events, constraints and uniqueness of multipliers.

All runs of a case are measured against the same context, which is computed once per case.
"""

from __future__ import annotations

import weakref
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from nsbench.case import Case
from nsbench.compilation.factories import as_numpy
from nsbench.dynamics.contacts.constraint_set import ConstraintSet, near_of
from nsbench.problem import LCS, Complementarity, Filippov, Hybrid, Problem
from nsbench.reference import Reference, canonical, files_of, reference, spread

WINDOW = 2  # sample spacings on each side of an event that are not "settled"
RANK = 1e-10  # relative singular value below which active gradients count as dependent
_frames: weakref.WeakKeyDictionary = weakref.WeakKeyDictionary()


@dataclass(frozen=True, eq=False)
class MeasureContext:
    """Context of one case with k samples.

    ref: its reference, or None. scene: its constraints (complementarity only). quiet (k - 1,):
    sample intervals outside the windows around events. unique: are the multipliers unique (None
    without a reference)? active: per sample the ids of contacts with a gap of zero. cache: what
    single measures keep between runs.
    """

    case: Case
    ref: Reference | None
    scene: ConstraintSet | None
    quiet: np.ndarray
    unique: bool | None
    active: tuple = ()
    cache: dict = field(default_factory=dict)

    @property
    def compared(self) -> str:
        """Return which error tells of the multipliers, "impulse" or "reaction"; "" without one."""
        if self.ref is None:
            return ""
        return "impulse" if self.unique and self.ref.knows_impulse else "reaction"


def context_of(case: Case) -> MeasureContext:
    """Find or compute the context of a case; anew when its stored reference changes on disk."""
    stamp = tuple(p.stat().st_mtime_ns if p.exists() else 0 for p in files_of(case))
    known = _frames.get(case)
    if known is None or known[0] != stamp:
        known = _frames[case] = (stamp, make_context(case, reference(case)))
    return known[1]


def make_context(case: Case, ref: Reference | None) -> MeasureContext:
    """Compute the context of a case from a reference: its own, or one that was just computed."""
    scene = (
        ConstraintSet(case.problem, case.n) if isinstance(case.problem, Complementarity) else None
    )
    if ref is None:
        return MeasureContext(case, None, scene, np.zeros(len(case.t) - 1, bool), None)
    quiet = outside_windows(case.t, event_times(case, ref))
    active = _active(case, ref, scene)
    tested = [
        k for k in range(len(case.t)) if quiet[max(k - 1, 0)] and quiet[min(k, len(quiet) - 1)]
    ]
    # with events everywhere the samples themselves are as good: an event seldom falls on one
    unique = all(_independent(case, ref, scene, k, active[k]) for k in tested or range(len(case.t)))
    return MeasureContext(case, ref, scene, quiet, unique, active)


def event_times(case: Case, ref: Reference) -> np.ndarray:
    """Collect the times of the reference's events.

    Where it stores none: the samples at which a contact starts or stops to act.
    """
    if ref.events is not None:
        return np.array([e.t for e in ref.events])
    if ref.impulse is None:
        return np.empty(0)
    return case.t[1:-1][changes(case.problem, case.t, ref.impulse)]


def pattern(problem: Problem, t: np.ndarray, impulse: np.ndarray) -> np.ndarray:
    """Classify the multipliers of each interval, (k - 1, m): 1 where one acts, else 0.

    Filippov, and the modes of hybrid systems: 0, 2 or, in between, 1. t (k,), impulse (k, m).
    """
    mean = np.diff(impulse, axis=0) / np.diff(t)[:, None]
    if isinstance(problem, (Filippov, Hybrid)):
        return (mean > 1e-9).astype(int) + (mean > 1 - 1e-9)
    return (mean > 1e-9 * max(1.0, float(np.abs(mean).max(initial=0.0)))).astype(int)


def changes(problem: Problem, t: np.ndarray, impulse: np.ndarray) -> np.ndarray:
    """Mark the inner samples (k - 2,) at which the pattern changes."""
    p = pattern(problem, t, impulse)
    return np.any(p[1:] != p[:-1], axis=1)


def outside_windows(t: np.ndarray, events: np.ndarray) -> np.ndarray:
    """Mark the intervals (k - 1,) to which no event comes closer than WINDOW sample spacings."""
    quiet = np.ones(len(t) - 1, bool)
    slack = 1e-9 * np.diff(t).min()
    for e in events:
        first = (
            np.searchsorted(t, e - slack, side="right") - 1
        )  # the interval that holds the event, or the two
        last = np.searchsorted(t, e + slack, side="left") - 1  # that meet in it
        quiet[max(last - WINDOW, 0) : max(first + WINDOW + 1, 0)] = False
    return quiet


def tolerance(ref: Reference) -> float:
    """Compute the gap below which a contact counts as closed.

    Ten times the reference's own error, and 1e-10 of the largest coordinate.
    """
    return 10.0 * ref.state_error + 1e-10 * max(1.0, float(np.abs(ref.x).max(initial=0.0)))


def _active(case: Case, ref: Reference, scene: ConstraintSet | None) -> tuple:
    """Collect by sample the ids of closed contacts, acting diodes (LCS), or surfaces at zero.

    Ids are canonical. Of a hybrid system none: the mode follows from the motion before.
    """
    if isinstance(case.problem, Hybrid):
        return ((),) * len(case.t)
    tol = tolerance(ref)
    out = []
    p = case.problem
    if isinstance(p, LCS):
        acts = np.zeros((len(case.t) + 1, p.B.shape[1]), bool)
        if ref.impulse is not None:
            acts[1:-1] = (
                spread(
                    p,
                    ref.contacts,
                    pattern(p, case.t, ref.impulse),
                    {(0, i): i for i in range(p.B.shape[1])},
                )
                > 0
            )
        return tuple(tuple((0, int(i)) for i in np.flatnonzero(a | b)) for a, b in pairwise(acts))
    switch = as_numpy(p.switch) if isinstance(p, Filippov) else None
    for t, x in zip(case.t, ref.x, strict=True):
        if switch is not None:
            out.append(tuple((0, int(i)) for i in np.flatnonzero(np.abs(switch(t, x)) <= tol)))
            continue
        near = scene.near(x, tol, t)
        closed = near.take(scene.gaps(t, x, near) <= tol)
        out.append(tuple(canonical(p, c) for c in closed.ids))
    return tuple(out)


def _independent(
    case: Case, ref: Reference, scene: ConstraintSet | None, k: int, active: tuple
) -> bool:
    """Do the multipliers of the active contacts follow from the motion at sample k?

    They do if the gradients have full column rank, by SVD.
    """
    p = case.problem
    if not active:
        return True
    if scene is not None:
        return full_rank(scene.gradients(float(case.t[k]), ref.x[k], near_of(scene, active)))
    from scipy.sparse import csr_array

    rows = [c[1] for c in active]
    if isinstance(p, LCS):  # B and, among what acts, D: what the motion and w = 0 say of lambda
        return full_rank(csr_array(np.vstack([p.B[:, rows], p.D[np.ix_(rows, rows)]]).T))
    field_ = as_numpy(p.field)
    s = np.ones(len(np.atleast_1d(as_numpy(p.switch)(float(case.t[k]), ref.x[k]))))
    if ref.impulse is not None:
        j = min(k, len(case.t) - 2)
        mean = (ref.impulse[j + 1] - ref.impulse[j]) / (case.t[j + 1] - case.t[j])
        s = 2 * spread(p, ref.contacts, mean[None], {(0, i): i for i in range(len(s))})[0] - 1

    def at(i: int, v: float) -> np.ndarray:
        q = s.copy()
        q[i] = v
        return field_(float(case.t[k]), ref.x[k], q)

    return full_rank(csr_array(np.array([at(i, 1.0) - at(i, -1.0) for i in rows])))


def full_rank(G) -> bool:
    """Are the rows of the sparse G independent?

    By singular values, relative 1e-10, per connected group of rows.
    """
    from scipy.sparse.csgraph import connected_components

    size = abs(G)
    count, label = connected_components(size @ size.T, directed=False)
    for c in range(count):
        rows = G[np.flatnonzero(label == c)]
        used = np.unique(rows.indices)
        if rows.shape[0] > used.size:
            return False
        s = np.linalg.svd(rows[:, used].toarray(), compute_uv=False)
        if not s[-1] > RANK * s[0]:
            return False
    return True
