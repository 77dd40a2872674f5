"""Characteristic length of a case that is run in the user's units, for absolute tolerances.

It serves violations of constraints (dynamics.contacts.tolerances) and implicit Euler. Methods that
run in a case's own units have its Scale instead (dynamics.scaling).
"""

from __future__ import annotations

import functools

import numpy as np

from nsbench.case import Case
from nsbench.compilation.factories import as_numpy
from nsbench.dynamics.contacts.time_dependence import SmoothRows
from nsbench.problem import Affine, Complementarity, Distance

LOOKS = 5  # times of a run
KRYLOV = 8  # dimensions of a motion beside the start
CLOSED = 1e-10  # of a vector: less of it outside a space is rounding
DOUBLINGS = 40  # of the first of the times at which that motion is looked at, up to the run's
SMALL = 1e-3  # size of a motion of which an absolute 1e-9 would be visible beside a rate


@functools.lru_cache(maxsize=64)
def case_length_scale(case: Case) -> float:
    """Return length_scale(case, case.x0); 1 where a function of the case raises.

    Such an error is reported where the function is called for its own sake.
    """
    try:
        return length_scale(case, case.x0)
    except Exception:
        return 1.0


def length_scale(case: Case, x0: np.ndarray) -> float:
    """Estimate the length of states, motion and constraints of a case; 1 unless it is much smaller.

    The case is a Complementarity or Filippov problem; x0 (n,). The estimate is the largest of the
    size of the state at the start, and of motion and constraints near it at LOOKS times of the run.
    A drift that pulls back moves a state until it is where it pulls to, which may be long before
    the end. Raises what a function of the case raises at the first of these times.
    """
    T = float(case.t[-1] - case.t[0])
    lengths = [float(np.abs(x0).max(initial=0.0))]
    motions = []
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
            lasts = np.where(
                change > 0.0, away / speed * np.abs(v) / change, T
            )  # of each coordinate
            size = np.fmax(
                size, min(float((np.abs(v) * np.fmin(T, lasts)).max()), _way(f, x0, v, away, T))
            )
    return float(size) if 0.0 < size < SMALL else 1.0


def _way(f, x0: np.ndarray, v: np.ndarray, away: float, T: float) -> float:
    """Estimate the largest displacement of a coordinate from x0 within T, in the linearised drift.

    The motion is x' = v + J (x - x0), with J from differences of f over the length `away`, in the
    Krylov space of v (Arnoldi 1951). A motion that turns comes back, so that v T may be far too
    much. Infinite where the result is not finite.
    """
    from scipy.linalg import expm

    many = min(x0.size, KRYLOV)
    # x - x0 = V y, y' = H y + |v| e_0
    V = np.zeros((many + 1, x0.size))
    H = np.zeros((many + 1, many + 1))
    most = float(np.abs(v).max())
    V[0], H[0, many] = v / most / np.linalg.norm(v / most), most * np.linalg.norm(v / most)
    # Arnoldi's method, orthogonalised twice; products J v by differences of f.
    for j in range(many):
        w = (_tried(f, x0 + away * V[j]) - v) / away
        whole = float(np.linalg.norm(w))
        if not np.isfinite(whole):
            return np.inf
        for _ in range(2):
            part = V[: j + 1] @ w
            H[: j + 1, j] += part
            w = w - part @ V[: j + 1]
        rest = float(np.linalg.norm(w))
        if rest <= CLOSED * whole or j + 1 == many:
            break
        H[j + 1, j] = rest
        V[j + 1] = w / rest
    # The displacement at T 2^-k for every k, by repeated squaring of the matrix exponential.
    E = expm(2.0**-DOUBLINGS * T * H)
    ways = []
    for _ in range(DOUBLINGS + 1):
        ways.append(float(np.abs(E[:many, many] @ V[:many]).max()))
        E = E @ E
    return max(ways) if np.all(np.isfinite(ways)) else np.inf


def _tried(f, x: np.ndarray) -> np.ndarray:
    """Evaluate f(x); return zeros where it raises, as the run may never be there."""
    try:
        return f(x)
    except Exception:
        return np.zeros(x.size)


def _motions(case: Case, t: float, x0: np.ndarray) -> list:
    """List functions of x: the drift at time t, or the fields on both sides of all surfaces."""
    p = case.problem
    if isinstance(p, Complementarity):
        drift = as_numpy(p.drift)
        return [lambda x: np.asarray(drift(t, x.copy()), float)]
    field = as_numpy(p.field)
    d = len(np.atleast_1d(as_numpy(p.switch)(t, x0.copy())))
    return [
        lambda x, s=s: np.asarray(field(t, x.copy(), np.full(d, s)), float) for s in (1.0, -1.0)
    ]


def _lengths(case: Case, t: float, x0: np.ndarray) -> list[float]:
    """List the lengths of the families of constraints at time t."""
    return (
        [_length(c, t, x0) for c in case.problem.constraints]
        if isinstance(case.problem, Complementarity)
        else []
    )


def _length(c, t: float, x: np.ndarray) -> float:
    """Return the length of a family of constraints.

    A distance: the largest one. Rows: the largest distance from the origin. Smooth constraints: the
    largest distance from the start, to first order.
    """
    if isinstance(c, Distance):
        return float(np.max(2.0 * c.radii if c.d is None else c.d))
    if isinstance(c, Affine):
        slope = np.sqrt(np.add.reduceat(c.data**2, c.indptr[:-1])) if c.shape[0] else np.empty(0)
        return float((np.abs(as_numpy(c.b)(t) if c.moving else c.b) / slope).max(initial=0.0))
    rows = SmoothRows(c, x.size)
    away = np.abs(rows.g(t, x)) / np.sqrt((rows.gradient(t, x) ** 2).sum(-1))
    return float(away.max(initial=0.0)) if np.all(np.isfinite(away)) else 1.0
