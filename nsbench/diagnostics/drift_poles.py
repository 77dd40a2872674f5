"""Poles of the drift between two samples: a fixed step passes over them, and no solution does.

The drift is evaluated on arrays that note what they are divided by. Where such a denominator
changes its sign, or touches zero, on the way from sample to sample, and |drift| times the distance
in time does not vanish there, the way to go is not finite: the integral of 1 / s diverges, that of
1 / sqrt(s) does not. A drift that divides floats, or by other things at other times, is looked at
where it is largest.
"""

from __future__ import annotations

import functools

import numpy as np

from nsbench.case import Case
from nsbench.compilation.factories import as_numpy
from nsbench.problem import LCS, Complementarity
from nsbench.trajectory import Status, Trajectory

POINTS = 200  # of a run at which denominators are compared, at least its samples
# of its largest value: a denominator without a change of sign that gets so small may touch zero
SMALL = 0.1
HALVINGS = 100
MOST = (
    100  # denominators that are followed to their zeros; of more, those where the drift is largest
)
BESIDE = 0.05  # of the way between the points around a zero: another way, beside it
# of the time between points: a distance at which the drift is compared; times that
NEARER = 1e-7
FURTHER = 1e3
ROUNDED = 1e4  # spacings of numbers that this distance has at least
VANISHES = 0.7  # a product of drift and distance falls to 0.5 for s^-0.9, and stays for 1 / s
IN_TIME = 1e-6  # of its largest value: a denominator that is as small there at other states too
OVER = {np.true_divide: 1, np.floor_divide: 1, np.remainder: 1, np.reciprocal: 0}


class DivisionRecorder(np.ndarray):
    """An array that appends what it divides by to `seen`."""

    seen: list = []

    def __array_ufunc__(self, ufunc, method, *inputs, out=None, **kwargs):
        plain = [np.asarray(v) for v in inputs]
        if method == "__call__":
            self._note(ufunc, inputs, plain)
        value = getattr(ufunc, method)(*plain, **kwargs)
        if out is not None:
            np.asarray(out[0])[...] = value
            return out[0]
        return _noting(value)

    @staticmethod
    def _note(ufunc, inputs, plain):
        k = OVER.get(ufunc)
        if k is not None and isinstance(inputs[k], DivisionRecorder):
            DivisionRecorder.seen.append(plain[k].ravel().astype(float))
        elif ufunc is np.tan:
            DivisionRecorder.seen.append(np.cos(plain[0]).ravel())
        elif (
            ufunc in (np.power, np.float_power)
            and isinstance(inputs[0], DivisionRecorder)
            and np.any(plain[1] < 0)
        ):
            DivisionRecorder.seen.append(plain[0].ravel().astype(float))

    def __getitem__(self, index):
        return _noting(super().__getitem__(index))

    def __iter__(self):
        return (self[k] for k in range(len(self)))


def _noting(value):
    return (
        np.asarray(value).view(DivisionRecorder)
        if np.asarray(value).dtype.kind == "f"
        else np.asarray(value)
    )


class _Space:
    """numpy, but that arrays made of noting ones note too."""

    def __getattr__(self, name):
        found = getattr(np, name)
        if isinstance(found, (np.ufunc, type)) or not callable(found):
            return found
        return lambda *args, **kwargs: _kept(found(*args, **kwargs))


def _kept(value):
    return _noting(value) if isinstance(value, (np.ndarray, np.floating)) else value


def check_drift_pole(case: Case, traj: Trajectory) -> Status | None:
    """diverged, if the drift has a pole in time on the straight way between two samples of the run;
    unverified, if it has one in the state, over which some solutions go (x' = 1 / x^2); None
    otherwise."""
    parts = max(1, -(-POINTS // max(1, len(traj.t) - 1)))
    times = np.append(
        (traj.t[:-1, None] + np.diff(traj.t)[:, None] * np.arange(parts) / parts).ravel(),
        traj.t[-1],
    )
    state = _way(traj)
    for drift, intervals in _drifts(case, traj):
        divisors = functools.partial(_denominators, drift)
        looked = np.repeat(intervals, parts)
        use = np.flatnonzero(np.append(looked, False) | np.append(False, looked))
        found = (
            [divisors(t, state(t)) for t in times[use]]
            if divisors(times[use[0]], state(times[use[0]])).size
            else [()]
        )
        if len(found[0]) == 0 or len({len(v) for v in found}) > 1:
            divisors = _reciprocals(drift, times[use], state)
            found = [divisors(t, state(t)) for t in times[use]]
        if np.all(np.isfinite(found)) and (
            status := _met(drift, divisors, use, np.array(found), traj, times, state)
        ):
            return status
    return None


def _way(traj):
    """t -> the state on the straight ways between the samples."""

    def state(t):
        k = min(max(int(np.searchsorted(traj.t, t, "right")) - 1, 0), len(traj.t) - 2)
        a = (t - traj.t[k]) / (traj.t[k + 1] - traj.t[k])
        return (1.0 - a) * traj.x[k] + a * traj.x[k + 1]

    return state


def _met(drift, divisors, use, values, traj, times, state) -> Status | None:
    """A pole of one drift on the way through `times`, by the values (U, m) of its divisors at those
    of `use` (U,)."""
    last = len(times) - 1
    columns = np.flatnonzero(
        (values.min(axis=0) * values.max(axis=0) <= 0.0)
        | (np.abs(values).min(axis=0) < SMALL * np.abs(values).max(axis=0))
    )
    suspects = [(int(use[k]), c, turns) for c in columns for k, turns in _suspects(values[:, c])]
    if len(suspects) > MOST:
        size = {
            k: _speed(drift, times[k], state(times[k])).max(initial=0.0)
            for k in {k for k, _, _ in suspects}
        }
        suspects = sorted(suspects, key=lambda s: -size[s[0]])[:MOST]
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
            return Status(
                "diverged",
                f"The drift has a pole at t = {at:.6g}, over which no solution goes: steps beside "
                "it hide that, however short.",
            )
        return Status(
            "unverified",
            f"The state goes over a pole of the drift, about t = {at:.6g}: steps beside it say "
            "nothing of what happens there.",
        )
    return None


def _pole_at(drift, divisors, column, state, ends, times) -> float | None:
    """Where a denominator vanishes between two times and the drift grows as at a pole; None where
    not, or not to be told."""
    try:
        at = _zero(lambda t: divisors(t, state(t))[column], *ends)
    except IndexError:  # other operations there
        return None
    return at if _grows(lambda t: _speed(drift, t, state(t)), at, times) else None


def _missed(drift, divisors, column, state, ends, times) -> bool:
    """Whether ways beside the straight one miss a pole where a denominator only touches zero: then
    it is one of the straight way, which leads through the inside of a curved one, as from one side
    of a vortex to the other."""
    moved = state(ends[1]) - state(ends[0])
    beside = BESIDE * np.abs(moved).max() * np.cos(1.0 + np.arange(moved.size))
    ways = [lambda t, s=s: state(t) + s * beside for s in (1.0, -1.0)]
    return any(_pole_at(drift, divisors, column, way, ends, times) is None for way in ways)


def _speed(drift, t, x) -> np.ndarray:
    """|drift|; no numbers where it raises."""
    try:
        return np.abs(np.asarray(as_numpy(drift)(t, x), float))
    except Exception:
        return np.full(x.size, np.nan)


def _drifts(case: Case, traj: Trajectory):
    """(xp -> (t, x) -> the velocity without reactions, (K - 1,) where it may be met): of a Filippov
    system the field of each mode that has samples, in the intervals beside these."""
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
    """All that the drift divides by at (t, x), in the order of its operations."""
    DivisionRecorder.seen = []
    with np.errstate(all="ignore"):
        try:
            drift(_Space())(_noting(t), _noting(x.copy()))
        except Exception:
            return np.empty(0)
    return np.concatenate(DivisionRecorder.seen) if DivisionRecorder.seen else np.empty(0)


def _reciprocals(drift, times, state):
    """(t, x) -> 1 / |drift|, no larger than at an ordinary time: for drifts that divide what does
    not note it, as floats."""
    speeds = np.nan_to_num(np.array([_speed(drift, t, state(t)) for t in times]), posinf=0.0)
    usual = np.median(speeds, axis=0)
    most = speeds.max(axis=0)
    least = np.where(usual > 0.0, usual, np.where(most > 0.0, 1e-3 * most, 1.0))
    return lambda t, x: 1.0 / np.maximum(np.nan_to_num(_speed(drift, t, x), nan=np.inf), least)


def _suspects(v):
    """Where a denominator changes its sign (the point behind), or has a least absolute value
    (True)."""
    a = np.abs(v)
    turns = np.flatnonzero((a[1:-1] <= a[:-2]) & (a[1:-1] <= a[2:])) + 1
    changes = np.flatnonzero(v[1:] * v[:-1] <= 0.0) + 1
    beside = {*changes, *(changes - 1)}
    return [
        *((k, v.min() >= 0.0 or v.max() <= 0.0) for k in changes),
        *((k, True) for k in turns if a[k] < SMALL * a.max() and k not in beside),
    ]


def _zero(den, low, high) -> float:
    """Where |den| is least between two times: a change of its sign, of the slope's otherwise."""
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
                maxiter=HALVINGS,
                disp=False,
            )
    return low


def _grows(speed, at, times) -> bool:
    """Does a component of the drift grow near `at`, on either side, as 1 / distance or faster?"""
    nearer = max(NEARER * float(np.diff(times).max()), ROUNDED * float(np.spacing(abs(at))))
    for side in (-1.0, 1.0):
        if times[0] <= at + side * FURTHER * nearer <= times[-1]:
            far, near = (speed(at + side * d) * d for d in (FURTHER * nearer, nearer))
            if np.any(np.isfinite(far) & (far > 0.0) & (near >= VANISHES * far)):
                return True
    return False
