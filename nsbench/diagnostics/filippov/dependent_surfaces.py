"""Layers around surfaces that are one, or meet in less than their number allows: they mix fields
that nowhere meet."""

from __future__ import annotations

from itertools import product

import numpy as np

from nsbench.case import Case
from nsbench.dynamics.filippov.convex_hull import distance_to_hull
from nsbench.dynamics.filippov.vector_field import FilippovVectorField

MOST = 4  # surfaces through one point whose sectors are all looked at
SHARE = 10.0  # times the layer by which a velocity that is off may move a run in all
MEET = 1e-9  # of the gradients, of length 1: so near to 0 a mixture of them is 0


def sector_signs(gradients: np.ndarray) -> np.ndarray:
    """(s, m) the signs that m switches with these gradients (m, n) have in the sectors around a
    zero of them all.

    By Gordan's theorem there is none with signs s if a mixture of the s_i x gradient i vanishes.
    """
    unit = gradients / np.linalg.norm(gradients, axis=1)[:, None]
    origin = np.zeros(unit.shape[1])
    signs = np.array(list(product((1.0, -1.0), repeat=len(unit))))
    return signs[[distance_to_hull(origin, s[:, None] * unit) > MEET for s in signs]]


def check_dependent_surfaces(case: Case, width: float, t: np.ndarray, X: np.ndarray) -> str:
    """Where a run with states X (K, n) at times t is in the layers c = clip(switch / width) of
    surfaces with dependent gradients, and its field there is none of those that Filippov's set has:
    x' in the hull of the fields of sectors; "" if nowhere.

    Surfaces that are one have layers of different thickness if one switch is steeper, and the
    weights of both are then those of no point beside them; so if a field is not affine in its
    signs.
    """
    motion = FilippovVectorField(case.problem, float(case.t[0]), X[0].copy())
    before = False
    with np.errstate(all="ignore"):
        for at, x in zip(t, X, strict=True):
            rows, off = _off(motion, width, float(at), x)
            here = off * float(t[-1] - t[0]) > SHARE * width
            if here and before:  # what is only passed is not in them twice
                return (
                    f"At t = {at:.6g} the layers of surfaces {', '.join(map(str, rows))}, whose "
                    f"normals are dependent, mix "
                    "fields that do not meet"
                )
            before = here
    return ""


def _off(motion, width, t, x) -> tuple:
    """The surfaces as near as the thickest of the layers that x is in, and how far its velocity is
    from the hull of their sectors' fields, in the unit of the flattest switch; 0 if all sectors are
    there."""
    c = motion.switch(t, x)
    if not (np.abs(c) < width).any():
        return (), 0.0
    slopes = np.linalg.norm(motion.gradients(t, x, np.arange(c.size)), axis=1)
    thick = np.max(width / slopes[np.abs(c) < width])
    rows = np.flatnonzero(np.abs(c) < slopes * thick)
    if not (2 <= rows.size <= MOST and np.isfinite(thick)):
        return (), 0.0
    there = sector_signs(motion.gradients(t, x, rows))
    if len(there) in (0, 2**rows.size):
        return (), 0.0
    signs = np.clip(c / width, -1.0, 1.0)
    fields = []
    for sides in there:
        s = signs.copy()
        s[rows] = sides
        fields.append(motion.field(t, x, s))
    off = distance_to_hull(motion.field(t, x, signs), np.array(fields))
    return rows, float(off * slopes[rows].min()) if np.isfinite(off) else 0.0
