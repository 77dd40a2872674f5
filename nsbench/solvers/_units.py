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

    The size of the state at the start; of motion and constraints beside it at LOOKS times of the run. A drift that pulls back
    moves a state until it is where it pulls to, which may be long before the end.
    """
    T, lengths, motions = float(case.t[-1] - case.t[0]), [float(np.abs(x0).max(initial=0.0))], []
    looks = np.linspace(case.t[0], case.t[-1], LOOKS).tolist()
    for t in looks:
        try:
            with np.errstate(all="ignore"):
                lengths += _lengths(case, t, x0)
                motions += [(f, f(x0)) for f in _motions(case, t, x0)]
        except Exception:
            if t == looks[0]:
                raise
    size = np.fmax.reduce(lengths)
    for f, v in motions:
        with np.errstate(all="ignore"):
            speed = float(np.abs(v).max(initial=0.0))
            if not 0.0 < speed * T < np.inf or speed * T <= size:
                continue
            away = size or speed * T
            change = np.abs(_tried(f, x0 + away * v / speed) - v)
            lasts = np.where(change > 0.0, away / speed * np.abs(v) / change, T)        # of each coordinate
            size = np.fmax(size, float((np.abs(v) * np.fmin(T, lasts)).max()))
    return float(size) if 0.0 < size < SMALL else 1.0


def _tried(f, x: np.ndarray) -> np.ndarray:
    """f(x), or zeros where it raises: the run may never be there."""
    try:
        return f(x)
    except Exception:
        return np.zeros(x.size)


def _motions(case: Case, t: float, x0: np.ndarray) -> list:
    """x -> drift at t, or the fields on both sides of all surfaces."""
    p = case.problem
    if isinstance(p, Complementarity):
        drift = p.drift(np)
        return [lambda x: np.asarray(drift(t, x.copy()), float)]
    field, d = p.field(np), len(np.atleast_1d(p.switch(np)(t, x0.copy())))
    return [lambda x, s=s: np.asarray(field(t, x.copy(), np.full(d, s)), float) for s in (1.0, -1.0)]


def _lengths(case: Case, t: float, x0: np.ndarray) -> list[float]:
    """The sizes of the families of constraints at t."""
    return [_length(c, t, x0) for c in case.problem.constraints] if isinstance(case.problem, Complementarity) else []


def _length(c, t: float, x: np.ndarray) -> float:
    """Size of a family of constraints: of rows how far from the origin, of smooth ones how far from the start, to first order."""
    if isinstance(c, Distance):
        return float(np.max(2.0 * c.radii if c.d is None else c.d))
    if isinstance(c, Affine):
        slope = np.sqrt(np.add.reduceat(c.data**2, c.indptr[:-1])) if c.shape[0] else np.empty(0)
        return float((np.abs(c.b(np)(t) if c.moving else c.b) / slope).max(initial=0.0))
    rows = SmoothRows(c, x.size)
    away = np.abs(rows.g(t, x)) / np.sqrt((rows.gradient(t, x) ** 2).sum(-1))
    return float(away.max(initial=0.0)) if np.all(np.isfinite(away)) else 1.0
