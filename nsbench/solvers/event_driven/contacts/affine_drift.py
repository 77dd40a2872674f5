"""Whether a drift is A x + c, proven for a box of states and the times of a run; and A, c."""

from __future__ import annotations

import numpy as np

from nsbench.case import Case
from nsbench.compilation.factories import as_numpy
from nsbench.solvers.event_driven.interval_taylor import ORDER, SPACE, Jet, as_jet

MOST = 4000  # states: beyond, columns of A are not asked for one by one
NOTHING = 1e-280  # what jets add to a product of zeros, against underflow, stays below


def affine_drift(case: Case, box: float):
    """(ptr, cols, vals, c) of x' = A x + c as CSR, valid while no |x_i| exceeds `box`; None if that
    is not proven.

    Jets with any first and no further derivative go through the drift: if nothing comes out in the
    second and higher orders, along every line and at every time, it is affine in x; if time alone
    moves and nothing comes out, it is autonomous. Enclosures hold on the whole box, so no bend can
    hide in it.
    """
    n = case.n
    lo = float(case.t[0])
    hi = float(case.t[-1])
    if n > MOST:
        return None
    time = _still(0.5 * (lo + hi), 0.5 * (hi - lo))
    state = _still(np.zeros(n), np.full(n, box))
    if not (_quiet(case, time, _moving(state), 2) and _quiet(case, _moving(time), state, 1)):
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
    return ptr, columns[order].astype(np.int64), vals[order], c


def _still(mid, rad) -> Jet:
    """Any constant within mid +- rad."""
    out = as_jet(np.asarray(mid, float), 1)
    out.rad[..., 0] = np.asarray(rad)[..., None]
    return out


def _moving(jet: Jet) -> Jet:
    """The same with any slope in [-1, 1]."""
    rad = jet.rad.copy()
    rad[..., 1] = 1.0
    return Jet(jet.mid, rad)


def _quiet(case, time, state, first) -> bool:
    """Whether the drift has no terms of order `first` and higher."""
    try:
        q = as_jet(case.problem.drift(SPACE)(time, state), 1)
    except (TypeError, ValueError, AttributeError, IndexError, NotImplementedError):
        return False  # not written in a way that Jets follow
    if q.shape != (case.n,):
        return False
    high = np.abs(q.mid[..., first : ORDER + 1]) + q.rad[..., first : ORDER + 1]
    return bool(np.all(high <= NOTHING) and np.all(np.isfinite(q.rad)))
