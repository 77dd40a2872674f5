"""Tolerances for violated constraints, relative to each constraint's own lengths and terms.

They hold in any unit and anywhere in space.
"""

from __future__ import annotations

import functools

import numpy as np

from nsbench.case import Case
from nsbench.dynamics.contacts.candidates import CandidateContacts
from nsbench.dynamics.contacts.constraint_set import PAIR, ConstraintSet
from nsbench.dynamics.length_scale import case_length_scale

TOLERANCE = 1e-9  # of a length; a start that misses by less is what whoever made it left out
LEAST = 1e-6  # unit: a start of 1e-16 may be a difference of numbers about 1
# of the numbers that a gap is made of: some hundred roundings, of whoever made them
ROUNDED = 1e-13
# of those numbers: ten digits of them; as long as it is no more than this of the length
PRINTED = 1e-9
HARMLESS = 1e-6
# of TOLERANCE, and of the numbers, sixteen roundings: what a projection may miss by
FINE = 1e-4
EXACT = 4e-15


@functools.lru_cache(maxsize=64)
def scene_of(case: Case) -> ConstraintSet:
    """Return the constraint set of a case, built once for each case."""
    return ConstraintSet(case.problem, case.n)


def tolerances(
    case: Case,
    scene: ConstraintSet,
    t: float,
    x: np.ndarray,
    near: CandidateContacts,
    projected: bool = False,
) -> np.ndarray:
    """Return (m,) how far the gaps of `near` at (t, x) may be below zero, each in its own unit.

    TOLERANCE of a length: the distance itself, or the characteristic length of the case for a row
    or a smooth constraint (by what the gap changes along it); and ROUNDED or, where that is
    harmless, PRINTED of the numbers that the gap is the difference of. Much less for what was
    projected.
    """
    length = gap_lengths(case, scene, t, x, near)
    terms = term_sizes(scene, t, x, near)
    if projected:
        return FINE * TOLERANCE * length + EXACT * terms
    return TOLERANCE * length + np.maximum(
        ROUNDED * terms, np.minimum(PRINTED * terms, HARMLESS * length)
    )


def gap_lengths(
    case: Case, scene: ConstraintSet, t: float, x: np.ndarray, near: CandidateContacts
) -> np.ndarray:
    """Return (m,) by how much the gaps of `near` change along their own length."""
    unit = max(case_length_scale(case), LEAST)
    layout = scene.layout(near)
    out = np.maximum(near.d, LEAST * unit)
    if layout.rows.size:
        out[layout.rows] = unit / np.sqrt(scene.inv2[near.p[layout.rows]])
    for family, sel in enumerate(layout.smooth):
        if sel.size:
            with np.errstate(all="ignore"):
                slope = np.sqrt((scene.smooth(family).gradient(t, x) ** 2).sum(-1))[near.p[sel]]
            out[sel] = unit * np.where(np.isfinite(slope), slope, 1.0)
    return out


def term_sizes(
    scene: ConstraintSet, t: float, x: np.ndarray, near: CandidateContacts
) -> np.ndarray:
    """Return (m,) the sizes of the terms that the gaps of `near` at (t, x) are differences of.

    Coordinates of the two ends of a distance, terms of a row; of a smooth constraint to first
    order, 0 where it has no gradient.
    """
    out = np.zeros(len(near))
    layout = scene.layout(near)
    for kind, sel, i, j in layout.pairs:
        out[sel] = np.abs(x[i]).max(axis=1) + np.abs(
            x[j] if kind == PAIR else scene.anchors(t)[j]
        ).max(axis=1)
    if layout.rows.size:
        terms = np.add.reduceat(np.abs(scene.vals * x[scene.cols]), scene.ptr[:-1]) + np.abs(
            scene.b(t)
        )
        out[layout.rows] = terms[near.p[layout.rows]]
    for family, sel in enumerate(layout.smooth):
        if sel.size:
            with np.errstate(all="ignore"):
                terms = np.abs(scene.smooth(family).gradient(t, x) * x).sum(-1)[near.p[sel]]
            out[sel] = np.where(np.isfinite(terms), terms, 0.0)
    return out


def violates(case: Case, scene: ConstraintSet, t: float, x: np.ndarray) -> bool:
    """Does x (n,) violate a constraint at t by more than its tolerance?

    A state that is not finite does.
    """
    near = scene.near(x, 0.0, t)
    g = scene.gaps(t, x, near)
    if (g >= 0.0).all():
        return False
    return bool(
        np.any(~(g >= 0.0) & ~(np.isfinite(g) & (g >= -tolerances(case, scene, t, x, near))))
    )
