"""Runs that stay on a surface which both fields leave: they may leave it at any time, and no one says which is meant."""
from __future__ import annotations

import numpy as np

from nsbench.case import Case
from nsbench.trajectory import Status, Trajectory

POINTS = 40              # of a run that are looked at, at least its samples
ON = 1e-9                # of the largest value of a switch: a state this near is on its surface
STEP = 1e-6              # of the run: the differences that rates of switches are taken from
ASIDE = 1e-9            # mean weight of a side below which a run was on the other alone
CLEAR = 1e-4             # of the largest rate: below it, nothing is said of its sign


def repelled(case: Case, traj: Trajectory) -> Status | None:
    """degenerate, if the state is on one surface at two samples in a row, and both fields lead away from it there or between
    (Filippov 1988, section 10: the solution to the right is not unique); None for cases that say so of themselves.

    A run that was on one side alone meanwhile has not stayed: it left and came back.
    """
    if not case.unique or len(traj.t) < 2:
        return None
    switch, field = case.problem.switch(np), case.problem.field(np)
    c = np.array([switch(t, x.copy()) for t, x in zip(traj.t, traj.x, strict=True)])
    on = np.abs(c) <= ON * np.maximum(np.abs(c).max(axis=0), swing(switch, traj.t[-1], traj.x))
    stayed = on[1:] & on[:-1] & _mixed(traj, c.shape[1])
    rows = np.flatnonzero(stayed.any(axis=0))
    parts = -(-POINTS // (len(traj.t) - 1))
    for i in rows:
        found, largest = [], 0.0
        for k in np.flatnonzero(stayed[:, i] & (on[1:].sum(axis=1) == 1)):
            for a in np.arange(1, parts + 1) / parts:
                t, x = (1.0 - a) * traj.t[k] + a * traj.t[k + 1], (1.0 - a) * traj.x[k] + a * traj.x[k + 1]
                rates = _rates(switch, field, t, x, i, STEP * (traj.t[-1] - traj.t[0]))
                found.append((t, *rates))
                largest = max(largest, *np.abs(rates))
        for t, plus, minus in found:
            if plus > CLEAR * largest and minus < -CLEAR * largest:
                return Status("degenerate", f"At t = {t:.6g} the state is on surface {i}, which both fields leave: it may leave "
                                            "to either side at any time.")
    return None


def _mixed(traj, d: int) -> np.ndarray:
    """(K - 1, d) where both sides of a surface have a part in the motion between two samples, or it is not known."""
    out = np.ones((len(traj.t) - 1, d), bool)
    for column, ident in enumerate(traj.contacts):
        weight = np.diff(traj.impulse[:, column]) / np.diff(traj.t)
        out[:, ident[1]] = ~((weight < ASIDE) | (weight > 1.0 - ASIDE))
    return out


def there(f, t, x, *signs) -> np.ndarray:
    """A switch or field at a point where the run need not have been; no number where it raises."""
    try:
        return np.asarray(f(t, x.copy(), *signs), float)
    except Exception:
        return np.array(np.nan)


def between(case: Case, width: float) -> str:
    """Whether the start is within `width` of a surface that both fields leave: a layer so thick decides for it; "" if not."""
    if not case.unique:
        return ""
    switch, field, t, x = case.problem.switch(np), case.problem.field(np), case.t[0], case.x0
    with np.errstate(all="ignore"):
        c = there(switch, t, x)
        for i in np.flatnonzero(np.abs(c) < width):
            plus, minus = _rates(switch, field, t, x, i, STEP * (case.t[-1] - t))
            if plus > 0.0 > minus:
                return f"The start is {abs(c[i]):.2g} from surface {i}, which both fields leave, and in its layer"
    return ""


def swing(switch, t: float, X: np.ndarray, least: float = 0.0) -> np.ndarray:
    """(d,) by how much each switch changes at the end (t, X[-1]) of a run where a coordinate changes by as much as any does in
    it, or by `least`."""
    x = X[-1]
    ways = max(float(np.abs(X - X[0]).max()), float(np.abs(X).max()), least) * np.eye(x.size)
    here = there(switch, t, x)
    largest = np.zeros_like(here)
    for e in ways:
        for s in (1.0, -1.0):
            largest = np.fmax(largest, np.abs(there(switch, t, x + s * e) - here))
    return largest


def _rates(switch, field, t, x, i, dt) -> tuple[float, float]:
    """Rates of switch i in the fields of its positive and its negative side, other signs as they are."""
    signs, out = np.where(there(switch, t, x) >= 0.0, 1.0, -1.0), []
    for side in (1.0, -1.0):
        signs[i] = side
        f = there(field, t, x, signs.copy())
        change = there(switch, t + dt, x + dt * f) - there(switch, t - dt, x - dt * f)
        out.append(float(change.ravel()[i] / (2.0 * dt)) if change.ndim else np.nan)
    return out[0], out[1]
