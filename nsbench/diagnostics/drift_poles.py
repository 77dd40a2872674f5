"""Check: a pole of the drift between two samples, over which fixed steps pass and no solution does.

The drift is evaluated on arrays that record what they are divided by. Where such a denominator
changes its sign, or touches zero, on the polygon of the samples, and |drift| times the distance in
time does not vanish there, the integral of the drift is not finite: that of 1 / s diverges, that of
1 / sqrt(s) does not. Of a drift that divides floats, or whose operations change with time, the
reciprocal of |drift| takes the place of the denominators.
"""

from __future__ import annotations

import functools

import numpy as np

from nsbench.case import Case
from nsbench.case.scale import time_text
from nsbench.compilation.factories import as_numpy
from nsbench.diagnostics.base import Finding
from nsbench.diagnostics.run_view import RunView
from nsbench.problem import LCS, Complementarity
from nsbench.trajectory import Trajectory

MIN_POINTS = 200  # of a run at which denominators are compared, at least its samples
# of its largest value: a denominator without a change of sign that gets so small may touch zero
SMALL = 0.1
MAX_BRENT_ITERATIONS = 100
# denominators that are followed to their zeros; of more, those where the drift is largest
MAX_SUSPECTS = 100
PARALLEL_OFFSET = 0.05  # of the displacement around a zero: distance of a parallel path
# of the time between points: the smaller distance at which the drift is compared, and the ratio of
# the larger one to it
NEAR_DISTANCE = 1e-7
DISTANCE_RATIO = 1e3
MIN_SPACINGS = 1e4  # spacings of numbers that the smaller distance has at least
# ratio of drift times distance: falls to 0.5 for s^-0.9, and stays 1 for 1 / s
STAYS = 0.7
# of its largest value: a denominator that is so small at other states too vanishes in time alone
IN_TIME = 1e-6
DIVISOR_INDEX = {np.true_divide: 1, np.floor_divide: 1, np.remainder: 1, np.reciprocal: 0}


class DivisionRecorder(np.ndarray):
    """An array that appends each array it is divided by to `divisors`."""

    divisors: list = []

    def __array_ufunc__(self, ufunc, method, *inputs, out=None, **kwargs):
        plain = [np.asarray(v) for v in inputs]
        if method == "__call__":
            self._record(ufunc, inputs, plain)
        value = getattr(ufunc, method)(*plain, **kwargs)
        if out is not None:
            np.asarray(out[0])[...] = value
            return out[0]
        return _recording(value)

    @staticmethod
    def _record(ufunc, inputs, plain):
        k = DIVISOR_INDEX.get(ufunc)
        if k is not None and isinstance(inputs[k], DivisionRecorder):
            DivisionRecorder.divisors.append(plain[k].ravel().astype(float))
        elif ufunc is np.tan:
            DivisionRecorder.divisors.append(np.cos(plain[0]).ravel())
        elif (
            ufunc in (np.power, np.float_power)
            and isinstance(inputs[0], DivisionRecorder)
            and np.any(plain[1] < 0)
        ):
            DivisionRecorder.divisors.append(plain[0].ravel().astype(float))

    def __getitem__(self, index):
        return _recording(super().__getitem__(index))

    def __iter__(self):
        return (self[k] for k in range(len(self)))


def _recording(value):
    """Return floats as an array that records its divisors; anything else as a plain array."""
    array = np.asarray(value)
    return array.view(DivisionRecorder) if array.dtype.kind == "f" else array


class _RecordingNumpy:
    """numpy as an array namespace whose functions return arrays that record their divisors."""

    def __getattr__(self, name):
        attribute = getattr(np, name)
        if isinstance(attribute, (np.ufunc, type)) or not callable(attribute):
            return attribute

        def function(*args: object, **kwargs: object) -> object:
            value = attribute(*args, **kwargs)
            return _recording(value) if isinstance(value, (np.ndarray, np.floating)) else value

        return function


def check_drift_pole(run: RunView) -> Finding | None:
    """Find a pole of the drift on the polygon of the samples, which the steps have passed over.

    A pole in time is one that no solution passes; a pole in the state may be passed by some
    solutions (x' = 1 / x^2).
    """
    traj = run.trajectory
    parts = max(1, -(-MIN_POINTS // max(1, len(traj.t) - 1)))
    times = np.append(
        (traj.t[:-1, None] + np.diff(traj.t)[:, None] * np.arange(parts) / parts).ravel(),
        traj.t[-1],
    )
    state = _sample_polygon(traj)
    for drift, intervals in _drifts(run.case, traj):
        divisors = functools.partial(_denominators, drift)
        examined = np.repeat(intervals, parts)
        use = np.flatnonzero(np.append(examined, False) | np.append(False, examined))
        values = [()]
        if divisors(times[use[0]], state(times[use[0]])).size:
            values = [divisors(t, state(t)) for t in times[use]]
        if len(values[0]) == 0 or len({len(v) for v in values}) > 1:
            divisors = _reciprocals(drift, times[use], state)
            values = [divisors(t, state(t)) for t in times[use]]
        if np.all(np.isfinite(values)):
            finding = _pole_of_drift(drift, divisors, use, np.array(values), traj, times, state)
            if finding:
                return finding
    return None


def _sample_polygon(traj: Trajectory):
    """t -> the state on the polygon of the samples, exact at both ends of every interval."""

    def state(t: float) -> np.ndarray:
        k = min(max(int(np.searchsorted(traj.t, t, "right")) - 1, 0), len(traj.t) - 2)
        a = (t - traj.t[k]) / (traj.t[k + 1] - traj.t[k])
        return (1.0 - a) * traj.x[k] + a * traj.x[k + 1]

    return state


def _pole_of_drift(drift, divisors, use, values, traj, times, state) -> Finding | None:
    """Look for a pole of one drift on the path through `times`.

    values (U, m): of its divisors at the times of the indices `use` (U,).
    """
    last = len(times) - 1
    columns = np.flatnonzero(
        (values.min(axis=0) * values.max(axis=0) <= 0.0)
        | (np.abs(values).min(axis=0) < SMALL * np.abs(values).max(axis=0))
    )
    suspects = [(int(use[k]), c, turns) for c in columns for k, turns in _suspects(values[:, c])]
    if len(suspects) > MAX_SUSPECTS:
        size = {
            k: _speed(drift, times[k], state(times[k])).max(initial=0.0)
            for k in {k for k, _, _ in suspects}
        }
        suspects = sorted(suspects, key=lambda s: -size[s[0]])[:MAX_SUSPECTS]
    for k, column, turns in suspects:
        ends = times[max(0, k - 1)], times[min(k + 1, last)]
        at = _pole_at(drift, divisors, column, state, ends, times)
        if at is None or (turns and _missed(drift, divisors, column, state, ends, times)):
            continue
        least = min(
            np.abs(divisors(at, x)[column : column + 1]).min(initial=np.inf)
            for x in (traj.x[0], traj.x[-1])
        )
        if least < IN_TIME * np.abs(values[:, column]).max():
            return Finding(
                "diverged",
                f"The drift has a pole at t = {time_text(at, 6)}, over which no solution goes: "
                "steps beside "
                "it hide that, however short.",
            )
        return Finding(
            "unverified",
            f"The state goes over a pole of the drift, about t = {time_text(at, 6)}: steps beside "
            "it say "
            "nothing of what happens there.",
        )
    return None


def _pole_at(drift, divisors, column, state, ends, times) -> float | None:
    """Return where a denominator vanishes between two times and the drift grows as at a pole.

    None where it does not, or where other operations are made there.
    """
    try:
        at = _zero(lambda t: divisors(t, state(t))[column], *ends)
    except IndexError:  # other operations there
        return None
    return at if _grows(lambda t: _speed(drift, t, state(t)), at, times) else None


def _missed(drift, divisors, column, state, ends, times) -> bool:
    """Does a path parallel to the polygon miss a pole where a denominator only touches zero?

    Then the pole is one of the polygon alone, which cuts through the inside of a curved path, as
    from one side of a vortex to the other.
    """
    moved = state(ends[1]) - state(ends[0])
    offset = PARALLEL_OFFSET * np.abs(moved).max() * np.cos(1.0 + np.arange(moved.size))
    paths = [lambda t, s=s: state(t) + s * offset for s in (1.0, -1.0)]
    return any(_pole_at(drift, divisors, column, path, ends, times) is None for path in paths)


def _speed(drift, t, x) -> np.ndarray:
    """Return |drift| (n,); NaN where it raises."""
    try:
        return np.abs(np.asarray(as_numpy(drift)(t, x), float))
    except Exception:
        return np.full(x.size, np.nan)


def _drifts(case: Case, traj: Trajectory):
    """List the drifts of a run, each with a (K - 1,) bool of the intervals where it may act.

    A drift is a factory xp -> (t, x) -> the velocity without reactions; of a Filippov system the
    field of each mode that has samples, in the intervals next to these.
    """
    p = case.problem
    everywhere = np.ones(len(traj.t) - 1, bool)
    if isinstance(p, Complementarity):
        return [(p.drift, everywhere)]
    if isinstance(p, LCS):
        # a q that goes to + infinity opens its row, and moves nothing
        parts = [
            *([lambda xp, t: p.u(xp)(t)] if p.u else []),
            *([lambda xp, t: xp.minimum(p.q(xp)(t), 0.0)] if p.q else []),
        ]
        return (
            [(lambda xp: lambda t, x: xp.hstack([part(xp, t) for part in parts]), everywhere)]
            if parts
            else []
        )
    switch = as_numpy(p.switch)
    values = np.array([switch(t, x.copy()) for t, x in zip(traj.t, traj.x, strict=True)])
    signs, which = np.unique(np.where(values >= 0.0, 1.0, -1.0), axis=0, return_inverse=True)
    which = which.ravel()
    return [
        (
            lambda xp, s=s: lambda t, x: p.field(xp)(t, x, s.copy()),
            (which[1:] == k) | (which[:-1] == k),
        )
        for k, s in enumerate(signs)
    ]


def _denominators(drift, t: float, x: np.ndarray) -> np.ndarray:
    """Return all values that the drift divides by at (t, x), in the order of its operations."""
    DivisionRecorder.divisors = []
    with np.errstate(all="ignore"):
        try:
            drift(_RecordingNumpy())(_recording(t), _recording(x.copy()))
        except Exception:
            return np.empty(0)
    return np.concatenate(DivisionRecorder.divisors) if DivisionRecorder.divisors else np.empty(0)


def _reciprocals(drift, times, state):
    """Return (t, x) -> 1 / |drift|, bounded by its value at an ordinary time.

    For drifts that divide what records nothing, as floats.
    """
    speeds = np.nan_to_num(np.array([_speed(drift, t, state(t)) for t in times]), posinf=0.0)
    usual = np.median(speeds, axis=0)
    most = speeds.max(axis=0)
    least = np.where(usual > 0.0, usual, np.where(most > 0.0, 1e-3 * most, 1.0))
    return lambda t, x: 1.0 / np.maximum(np.nan_to_num(_speed(drift, t, x), nan=np.inf), least)


def _suspects(v):
    """List where a denominator v (U,) changes its sign, or has a least absolute value.

    Returns pairs of the index (behind the change) and whether v only touches zero there.
    """
    a = np.abs(v)
    turns = np.flatnonzero((a[1:-1] <= a[:-2]) & (a[1:-1] <= a[2:])) + 1
    changes = np.flatnonzero(v[1:] * v[:-1] <= 0.0) + 1
    at_changes = {*changes, *(changes - 1)}
    return [
        *((k, v.min() >= 0.0 or v.max() <= 0.0) for k in changes),
        *((k, True) for k in turns if a[k] < SMALL * a.max() and k not in at_changes),
    ]


def _zero(den, low, high) -> float:
    """Return where |den| is least between two times: at a change of its sign, or of its slope."""
    from scipy.optimize import brentq

    eps = 1e-9 * (high - low)
    for f in (den, lambda t: abs(den(t + eps)) - abs(den(t - eps))):
        if np.sign(f(low)) * np.sign(f(high)) <= 0.0:  # a product of small ones would be 0
            number = lambda t, f=f: v if np.isfinite(v := f(t)) else 0.0
            return brentq(
                number,
                low,
                high,
                xtol=np.spacing(max(abs(low), abs(high))),
                maxiter=MAX_BRENT_ITERATIONS,
                disp=False,
            )
    return low


def _grows(speed, at, times) -> bool:
    """Does a component of the drift grow near `at`, on either side, as 1 / distance or faster?"""
    near = max(
        NEAR_DISTANCE * float(np.diff(times).max()), MIN_SPACINGS * float(np.spacing(abs(at)))
    )
    far = DISTANCE_RATIO * near
    for side in (-1.0, 1.0):
        if times[0] <= at + side * far <= times[-1]:
            outer, inner = (speed(at + side * d) * d for d in (far, near))
            if np.any(np.isfinite(outer) & (outer > 0.0) & (inner >= STAYS * outer)):
                return True
    return False
