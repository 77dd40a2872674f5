"""Prove that a drift is A x + c for a box of states and the times of a run, and find A and c.

The proof evaluates the drift with interval Taylor series (see interval_taylor).
"""

from __future__ import annotations

import numpy as np

from nsbench.case import Case
from nsbench.compilation.factories import as_numpy
from nsbench.solvers.event_driven.contacts.kernels.loop_state import AffineDrift
from nsbench.dynamics.interval_taylor import ORDER, SPACE, Jet, as_jet, enclosing

MAX_STATES = 4000  # beyond, evaluating the columns of A one by one takes too long
UNDERFLOW = 1e-280  # Jets add less than this to a product of zeros, against underflow


def affine_drift(case: Case, box: float) -> AffineDrift | None:
    """Return the drift as f = A x + c, valid while no |x_i| exceeds `box`; None if that is not
    proven.

    Jets with any first and no further derivative go through the drift: if the second and higher
    orders vanish, along every line and at every time, it is affine in x; if only time moves and the
    first order vanishes too, it is autonomous. Enclosures hold on the whole box, so no curvature
    can hide in it. The columns of A are differences of two values, which are exact up to rounding.
    """
    n = case.n
    lo = float(case.t[0])
    hi = float(case.t[-1])
    if n > MAX_STATES:
        return None
    time = enclosing(np.full(1, 0.5 * (lo + hi)), np.full(1, 0.5 * (hi - lo)))
    state = enclosing(np.zeros((n, 1)), np.full((n, 1), box))
    if not (
        _has_no_terms(case, time, _with_any_slope(state), 2)
        and _has_no_terms(case, _with_any_slope(time), state, 1)
    ):
        return None
    f = as_numpy(case.problem.drift)
    c = np.array(f(lo, np.zeros(n)), float)
    unit = 2.0 ** np.ceil(np.log2(1.0 + np.abs(c).max(initial=0.0)))  # differences round like c
    unit = min(unit, box)
    ptr = np.zeros(n + 1, np.int64)
    rows = []
    vals = []
    columns = []
    for k in range(n):
        e = np.zeros(n)
        e[k] = unit
        a = (np.asarray(f(lo, e), float) - np.asarray(f(lo, -e), float)) / (2.0 * unit)
        i = np.flatnonzero(a)
        rows.append(i)
        columns.append(np.full(len(i), k))
        vals.append(a[i])
    rows, columns, vals = (np.concatenate(v) for v in (rows, columns, vals))
    order = np.lexsort((columns, rows))
    np.cumsum(np.bincount(rows, minlength=n), out=ptr[1:])
    if not (np.all(np.isfinite(vals)) and np.all(np.isfinite(c))):
        return None
    return AffineDrift(ptr, columns[order].astype(np.int64), vals[order], c)


def _with_any_slope(jet: Jet) -> Jet:
    """Enclose the same values with any slope in [-1, 1]."""
    rad = jet.rad.copy()
    rad[..., 1] = 1.0
    return Jet(jet.mid, rad)


def _has_no_terms(case, time, state, first) -> bool:
    """Check that the drift has no terms of order `first` and higher."""
    try:
        enclosure = as_jet(case.problem.drift(SPACE)(time, state), 1)
    except (TypeError, ValueError, AttributeError, IndexError, NotImplementedError):
        return False  # not written in a way that Jets follow
    if enclosure.shape != (case.n,):
        return False
    high = np.abs(enclosure.mid[..., first : ORDER + 1]) + enclosure.rad[..., first : ORDER + 1]
    return bool(np.all(high <= UNDERFLOW) and np.all(np.isfinite(enclosure.rad)))
