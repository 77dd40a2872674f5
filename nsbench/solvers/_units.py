"""The unit of a case: tolerances that are absolute are relative to it."""
from __future__ import annotations

import functools

import numpy as np

from nsbench.case import Case
from nsbench.moving import SmoothRows
from nsbench.problem import Affine, Complementarity, Distance

LOOKS = 5                 # times of a run
SMALL = 1e-3              # size of a motion of which an absolute 1e-9 would be visible beside a rate


@functools.lru_cache(maxsize=64)
def unit_of(case: Case) -> float:
    """unit(case, case.x0); 1 where the case's own functions raise, which is told where they are called for."""
    try:
        return unit(case, case.x0)
    except Exception:
        return 1.0


def unit(case: Case, x0: np.ndarray) -> float:
    """1, or the size of states, motion and constraints (of a Complementarity or Filippov problem) where that is much smaller.

    The size of the state at the start; of motion and constraints beside it at LOOKS times of the run.
    """
    found = [_sizes(case, float(case.t[0]), x0)]
    for t in np.linspace(case.t[0], case.t[-1], LOOKS)[1:].tolist():
        try:
            found.append(_sizes(case, t, x0))
        except Exception:                # the run may never be there
            continue
    lengths, speeds = np.array(found).T
    size = max(float(lengths.max()), float(np.abs(x0).max()), float(case.t[-1] - case.t[0]) * float(speeds.max()))
    return size if 0.0 < size < SMALL else 1.0


def _sizes(case: Case, t: float, x0: np.ndarray) -> tuple[float, float]:
    """The largest length of the constraints, and the largest speed, at x0."""
    p = case.problem
    with np.errstate(all="ignore"):
        if isinstance(p, Complementarity):
            fields, lengths = [p.drift(np)(t, x0.copy())], [_length(c, t, x0) for c in p.constraints]
        else:
            d, lengths = len(np.atleast_1d(p.switch(np)(t, x0.copy()))), []
            fields = [p.field(np)(t, x0.copy(), np.full(d, s)) for s in (1.0, -1.0)]
        return max(lengths, default=0.0), max(float(np.abs(f).max(initial=0.0)) for f in fields)


def _length(c, t: float, x: np.ndarray) -> float:
    """Size of a family of constraints: of smooth ones how far the start is from them, to first order."""
    if isinstance(c, Distance):
        return float(np.max(2.0 * c.radii if c.d is None else c.d))
    if isinstance(c, Affine):
        return float(np.abs(c.b(np)(t) if c.moving else c.b).max(initial=0.0))
    rows = SmoothRows(c, x.size)
    away = np.abs(rows.g(t, x)) / np.sqrt((rows.gradient(t, x) ** 2).sum(-1))
    return float(away.max(initial=0.0)) if np.all(np.isfinite(away)) else 1.0
