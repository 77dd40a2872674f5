"""Sizes of a motion before it is run: of each coordinate, of its time, and of its constraints.

Every quantity here is homogeneous in the units of time and coordinates, and every unit is a power
of two: the same system in units that differ by powers of two has the same sizes, to the last bit.
"""

from __future__ import annotations

import functools
from collections.abc import Callable

import numpy as np

from nsbench.case import Case
from nsbench.case.scale import Scale
from nsbench.compilation.factories import as_numpy
from nsbench.dynamics.contacts.time_dependence import SmoothRows
from nsbench.problem import LCS, Affine, Complementarity, Distance, Filippov, Hybrid, Smooth

# parts of the run, from its start, at which the fields at the start are looked at: a motion that is
# fast at first must not be judged by its end
LOOKS = (0.0, 2.0**-20, 2.0**-10, 2.0**-5, 0.125, 0.25, 0.5, 0.75, 1.0)
KRYLOV = 8  # dimensions of a motion beside the start
NO_LENGTH = 1e-14  # a distance of a scene at rest in its origin: a difference of numbers about 1
INSTANT = 2.0**-26  # of the run, over which a switch is differenced in time
CLOSED = 1e-10  # of a vector: less of it outside a space is rounding
# times a size found from the speeds at the start, which was then next to nothing, where the
# coordinate gets farther once the others have moved, or in the modes that act around the start
FARTHER = 2.0**20
DOUBLINGS = 40  # of the first of the times at which that motion is looked at, up to the run's


def power_of_two(v):
    """Return the least power of two that is no less, of each positive number; 1.0 of the others."""
    v = np.asarray(v, float)
    good = np.isfinite(v) & (v > 0.0)
    part, exponent = np.frexp(np.where(good, v, 1.0))
    exponent = np.clip(exponent - (part == 0.5), -1000, 1000)
    out = np.where(good, np.ldexp(1.0, exponent), 1.0)
    return out if out.ndim else float(out)


@functools.lru_cache(maxsize=64)
def case_scale(case: Case) -> Scale:
    """Return the units of the case: those it states, else those found from the start.

    Where a function of the case raises, the sizes of the start count: the error is reported where
    the function is called for its own sake.
    """
    if case.scale is not None:
        return case.scale
    span = float(case.t[-1] - case.t[0])
    try:
        with np.errstate(all="ignore"):
            return _estimate(case, span)
    except Exception:
        return Scale(span, _filled(np.abs(case.x0)))


def _filled(sizes: np.ndarray) -> np.ndarray:
    """Return the sizes (n,), with the largest in place of those that are zero; 1.0 if all are."""
    sizes = np.where(np.isfinite(sizes), sizes, 0.0)
    return np.where(sizes > 0.0, sizes, sizes.max(initial=0.0) or 1.0)


def _estimate(case: Case, span: float) -> Scale:
    """Return time and sizes by the start, the constraints, and the motion near the start."""
    t0 = float(case.t[0])
    x0 = case.x0
    sizes = np.abs(x0)
    uniform = isinstance(case.problem, Complementarity)
    if uniform:
        sizes = np.full(case.n, particle_distance(case))
    fields = [(f, f(x0)) for part in LOOKS for f in _fields(case, t0 + part * span)]
    fields = [(f, np.where(np.isfinite(v), v, 0.0)) for f, v in fields]
    # Sizes of the motion by the speeds alone, as units in which the motion is then estimated.
    rough = _filled(np.maximum(sizes, span * np.max([np.abs(v) for _, v in fields], axis=0)))
    rough = np.full(case.n, rough.max()) if uniform else rough
    away = np.where(sizes > 0.0, sizes, rough)
    linear = [_krylov(f, x0, v, away, span) for f, v in fields]
    acting = [f for f, _ in fields]
    if isinstance(case.problem, Filippov):
        acting = _acting_fields(case, [t0 + part * span for part in LOOKS])
    moved = np.zeros(case.n)
    for (f, v), g, far in zip(fields, acting, linear, strict=True):
        found = _displacement(f, x0, v, away, rough, span, far)
        if g is not f:  # what a mode does where it never acts must not make the motion tiny
            there = _displacement(g, x0, v, away, rough, span, _krylov(g, x0, v, away, span))
            found = np.where(there > FARTHER * found, there, found)
        moved = np.maximum(moved, found)
    if uniform:  # one length: that of particles, or the amplitude of the motion, wherever it is
        length = max(sizes.max(), 0.5 * moved.max(), 0.5 * _wall_motion(case, span))
        own = np.full(case.n, length or np.abs(x0).max() or _nearest_wall(case) or 1.0)
    else:
        own = np.where(moved > 0.0, moved, sizes)
        later = np.max([_speeds_around(g, x0, moved) for g in acting], axis=0)
        beside = np.max(linear, axis=0)
        # of a linearised motion that overflows, which something must hold back, nothing is known
        far = np.where(np.isfinite(beside), np.minimum(beside, span * later), 0.0)
        own = _filled(np.where((far > FARTHER * own) & (own > 0.0), far, own))
    return Scale(_time(case, [v for _, v in fields], own, span), own)


def scale_of_sizes(case: Case, sizes: np.ndarray) -> Scale:
    """Return the units of the case whose coordinates are known to be of these sizes (n,)."""
    span = float(case.t[-1] - case.t[0])
    t0 = float(case.t[0])
    with np.errstate(all="ignore"):
        speeds = [_tried(f, case.x0) for part in LOOKS for f in _fields(case, t0 + part * span)]
    speeds = [np.where(np.isfinite(v), v, 0.0) for v in speeds]
    return Scale(_time(case, speeds, sizes, span), sizes)


def _time(case: Case, speeds: list[np.ndarray], sizes: np.ndarray, span: float) -> float:
    """Return the time in which the fastest coordinate, or switch in time, goes about its size.

    `span` at most.
    """
    rate = max(float((np.abs(v) / sizes).max(initial=0.0)) for v in speeds)
    if isinstance(case.problem, (Filippov, Hybrid)):
        rate = max(rate, _switch_rate(case, span))
    return min(span, 1.0 / rate) if rate > 0.0 else span


def _switch_rate(case: Case, span: float) -> float:
    """Return the largest rate at which time alone changes a switch, in parts of what it reaches."""
    switch = _switches(case.problem)
    times = [float(case.t[0]) + part * span for part in LOOKS]
    c = np.array([np.atleast_1d(switch(t, case.x0.copy())) for t in times])
    later = np.array([np.atleast_1d(switch(t + INSTANT * span, case.x0.copy())) for t in times])
    reached = np.nanmax(np.abs(c), axis=0, initial=0.0)
    slopes = np.nanmedian(np.abs(later - c), axis=0) / (INSTANT * span)  # a jump is no slope
    with np.errstate(all="ignore"):
        return float(np.nanmax(np.where(reached > 0.0, slopes / reached, 0.0), initial=0.0))


def _switches(p: Filippov | Hybrid) -> Callable:
    """Return (t, x) -> (d,) the switches of a Filippov system, or the guards of a hybrid one."""
    if isinstance(p, Filippov):
        return as_numpy(p.switch)
    guards = [as_numpy(transition.guard) for transition in p.transitions]
    return lambda t, x: np.array([float(np.asarray(c(t, x)).item()) for c in guards])


def switch_sizes(case: Case, lengths: np.ndarray | None = None) -> np.ndarray:
    """Return (d,) the sizes of the switches of a Filippov case.

    The largest value at the start, at any of the times that are looked at, or change from there by
    a coordinate of its size; lengths (n,): these sizes, one in own units. Ones where a switch
    cannot be evaluated.
    """
    switch = as_numpy(case.problem.switch)
    t0 = float(case.t[0])
    span = float(case.t[-1]) - t0
    x0 = case.x0

    def at(t: float, x: np.ndarray) -> np.ndarray:
        return np.atleast_1d(switch(t, x.copy()))

    try:
        with np.errstate(all="ignore"):
            found = [at(t0 + part * span, x0) for part in LOOKS]
            moves = np.diag(np.ones(x0.size) if lengths is None else lengths)
            found += [at(t0, x0 + e) - found[0] for e in moves]
    except Exception:
        return np.ones(1)
    sizes = np.abs(np.array(found, float))
    return np.where(np.isfinite(sizes), sizes, 0.0).max(axis=0)


def _speeds_around(f, x0, moved) -> np.ndarray:
    """Return the largest speed (n,) of each coordinate where all have moved by so much (n,)."""
    found = np.abs([_tried(f, x0 + moved), _tried(f, x0 - moved)])
    return np.where(np.isfinite(found), found, 0.0).max(axis=0)


def _displacement(f, x0, v, away, rough, span, linear) -> np.ndarray:
    """Estimate (n,) how far each coordinate gets from x0 within `span` in the field f, v = f(x0).

    At most its speed times the time; less where the field pulls back, to first order along v, and
    in the linearised motion, which gets `linear` (n,) far, where the coordinate turns round.
    """
    far = np.abs(v) * span
    if not far.any():
        return far
    y = v / rough
    part = 1.0 / max(float(np.abs(y).max()) * span, float((np.abs(v) / away).max()) * span)
    step = part * span
    change = np.abs(_tried(f, x0 + step * v) - v)
    lasts = np.where(change > 0.0, step * np.abs(v) / np.where(change > 0.0, change, 1.0), span)
    return np.minimum(np.abs(v) * np.fmin(span, lasts), linear)


def _krylov(f, x0, v, unit, span) -> np.ndarray:
    """Estimate (n,) the largest displacements from x0 within `span` of the linearised motion.

    The motion is y' = v + J y, with J from differences of f over `unit`, in the Krylov space of v
    (Arnoldi 1951). A motion that turns comes back, so that v times the span may be far too much.
    Infinite where the result is not finite.
    """
    from scipy.linalg import expm

    n = x0.size
    many = min(n, KRYLOV)
    w0 = span * v / unit
    if not w0.any():
        return np.zeros(n)
    # y = unit V z, z' = (H z + |w0| e_0) / span
    V = np.zeros((many + 1, n))
    H = np.zeros((many + 1, many + 1))
    norm = _norm(w0)
    V[0] = w0 / norm
    H[0, many] = norm
    # Arnoldi's method, orthogonalised twice; products J v by differences of f.
    for j in range(many):
        w = span * (_tried(f, x0 + unit * V[j]) - v) / unit
        whole = _norm(w)
        if not np.isfinite(whole):
            return np.full(n, np.inf)
        for _ in range(2):
            part = V[: j + 1] @ w
            H[: j + 1, j] += part
            w = w - part @ V[: j + 1]
        rest = _norm(w)
        if rest <= CLOSED * whole or j + 1 == many:
            break
        H[j + 1, j] = rest
        V[j + 1] = w / rest
    # The displacement at span 2^-k for every k, by repeated squaring of the matrix exponential.
    E = expm(2.0**-DOUBLINGS * H)
    far = np.zeros(n)
    for _ in range(DOUBLINGS + 1):
        far = np.maximum(far, np.abs(E[:many, many] @ V[:many]))
        E = E @ E
    return np.where(np.all(np.isfinite(far)), unit * far, np.inf)


def _norm(w: np.ndarray) -> float:
    """Return the Euclidean norm without overflow."""
    most = float(np.abs(w).max(initial=0.0))
    return most * float(np.linalg.norm(w / most)) if most > 0.0 else 0.0


def _tried(f: Callable, x: np.ndarray) -> np.ndarray:
    """Evaluate f(x); return zeros where it raises, as the run may never be there."""
    try:
        return f(x)
    except Exception:
        return np.zeros(x.size)


def _fields(case: Case, t: float) -> list[Callable]:
    """List functions of x at time t: the drift, those of all modes, or the fields on both sides of
    all surfaces."""
    p = case.problem
    if isinstance(p, LCS):
        u = as_numpy(p.u)(t) if p.u else 0.0
        return [lambda x: p.A @ x + u]
    if isinstance(p, Complementarity):
        drift = as_numpy(p.drift)
        return [lambda x: np.asarray(drift(t, x.copy()), float)]
    if isinstance(p, Hybrid):
        drifts = map(as_numpy, p.modes.values())
        return [lambda x, f=f: np.asarray(f(t, x.copy()), float) for f in drifts]
    field = as_numpy(p.field)
    d = len(np.atleast_1d(as_numpy(p.switch)(t, case.x0.copy())))
    return [
        lambda x, s=s: np.asarray(field(t, x.copy(), np.full(d, s)), float) for s in (1.0, -1.0)
    ]


def _acting_fields(case: Case, times: list[float]) -> list[Callable]:
    """List functions of x at these times as `_fields` does, each the field of the side on which x
    lies.

    A mode may grow beyond all bounds where it does not act: friction that falls with the speed,
    exp(-w / w0), on the side of negative w.
    """
    field = as_numpy(case.problem.field)
    switch = as_numpy(case.problem.switch)

    def acting(t: float, x: np.ndarray) -> np.ndarray:
        side = np.where(np.atleast_1d(switch(t, x.copy())) < 0.0, -1.0, 1.0)
        return np.asarray(field(t, x.copy(), side), float)

    return [functools.partial(acting, t) for t in times for _ in _fields(case, t)]


def particle_distance(case: Case) -> float:
    """Return the largest distance that particles of a gradient system keep or may have; else 0."""
    distances = [
        float(np.max(2.0 * c.radii if c.d is None else c.d, initial=0.0))
        for c in case.problem.constraints
        if isinstance(c, Distance)
    ]
    return max(distances, default=0.0)


def particle_diameter(case: Case) -> float:
    """Return the smallest distance that hard particles keep; the lengths of links are none.

    Of a case with links alone the longest link; 0.0 where there are no distances.
    """
    if not isinstance(case.problem, Complementarity):
        return 0.0
    hard = [c for c in case.problem.constraints if isinstance(c, Distance) and c.sign > 0]
    kept = [np.min(2.0 * c.radii if c.d is None else c.d, initial=np.inf) for c in hard]
    smallest = float(min(kept, default=np.inf))
    return smallest if smallest < np.inf else particle_distance(case)


def own_length(case: Case) -> float:
    """Return the length that the case itself gives, of which its violations are a per cent.

    The diameter of its particles, else the largest size of `Case.scale`; 0.0 where it has neither,
    as no length is estimated here.
    """
    stated = 0.0 if case.scale is None else case.scale.length
    return particle_diameter(case) or stated


def _wall_motion(case: Case, span: float) -> float:
    """Return how far the farthest moving wall or anchor goes within the run; 0.0 if all rest."""
    t0 = float(case.t[0])
    found = [0.0]
    for c in case.problem.constraints:
        if isinstance(c, Smooth) or not c.moving:
            continue
        curve = as_numpy(c.b if isinstance(c, Affine) else c.anchors)
        slope = _row_norms(c) if isinstance(c, Affine) else 1.0
        start = np.asarray(curve(t0), float)
        for part in LOOKS[1:]:
            way = np.abs(np.asarray(curve(t0 + part * span), float) - start) / slope
            found.append(float(way[np.isfinite(way)].max(initial=0.0)))
    return max(found)


def _row_norms(c: Affine) -> np.ndarray:
    return np.sqrt(np.add.reduceat(c.data**2, c.indptr[:-1])) if c.shape[0] else np.empty(0)


def _nearest_wall(case: Case) -> float:
    """Return the distance from the start to the nearest row or smooth constraint, to first order.

    0.0 where there is none, or the start lies on all but for rounding.
    """
    t = float(case.t[0])
    x = case.x0
    found = [np.empty(0)]
    for c in case.problem.constraints:
        if isinstance(c, Affine) and c.shape[0]:
            gap = np.add.reduceat(c.data * x[c.indices], c.indptr[:-1])
            found.append(np.abs(gap + (as_numpy(c.b)(t) if c.moving else c.b)) / _row_norms(c))
        elif isinstance(c, Smooth):
            rows = SmoothRows(c, x.size)
            found.append(np.abs(rows.g(t, x)) / np.sqrt((rows.gradient(t, x) ** 2).sum(-1)))
    far = np.concatenate(found)
    far = far[np.isfinite(far) & (far > NO_LENGTH)]
    return float(far.min()) if far.size else 0.0
