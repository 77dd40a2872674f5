"""The unit of a case: tolerances that are absolute are relative to it."""
from __future__ import annotations

import functools

import numpy as np

from nsbench.case import Case
from nsbench.moving import SmoothRows
from nsbench.problem import Affine, Complementarity, Distance

SMALL = 1e-3              # size of a motion of which an absolute 1e-9 would be visible beside a rate


@functools.lru_cache(maxsize=64)
def unit_of(case: Case) -> float:
    """unit(case, case.x0); 1 where the case's own functions raise, which is told where they are called for."""
    try:
        return unit(case, case.x0)
    except Exception:
        return 1.0


def unit(case: Case, x0: np.ndarray) -> float:
    """1, or the size of states, motion and constraints (of a Complementarity or Filippov problem) where that is much smaller."""
    p, t, lengths = case.problem, case.t[0], [0.0]
    with np.errstate(all="ignore"):
        if isinstance(p, Complementarity):
            speeds = [p.drift(np)(t, x0.copy())]
            lengths += [_length(c, t, x0) for c in p.constraints]
        else:
            d = len(np.atleast_1d(p.switch(np)(t, x0.copy())))
            speeds = [p.field(np)(t, x0.copy(), np.full(d, s)) for s in (1.0, -1.0)]
        size = max(*lengths, float(np.abs(x0).max()), float(case.t[-1] - t) * float(np.abs(speeds).max(initial=0.0)))
    return size if 0.0 < size < SMALL else 1.0


def _length(c, t: float, x: np.ndarray) -> float:
    """Size of a family of constraints: of smooth ones how far the start is from them, to first order."""
    if isinstance(c, Distance):
        return float(np.max(2.0 * c.radii if c.d is None else c.d))
    if isinstance(c, Affine):
        return float(np.abs(c.b(np)(t) if c.moving else c.b).max(initial=0.0))
    rows = SmoothRows(c, x.size)
    away = np.abs(rows.g(t, x)) / np.sqrt((rows.gradient(t, x) ** 2).sum(-1))
    return float(away.max(initial=0.0)) if np.all(np.isfinite(away)) else 1.0
