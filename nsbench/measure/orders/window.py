"""Selection of the points of a step ladder that enter a fit.

They are finite, above the floors, and no outliers.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

EPS = float(np.finfo(float).eps)
APART = 0.001  # level (for the whole ladder) at which one error is called apart from the others
PHASE = 0.02  # of an octave: steps closer than this in log2 h, modulo one, are at the same phase
DIP = 1 / 3  # of the floor: an error below says nothing, even among larger ones
# accuracies whose values mean something for a floor; of any other (k) nothing is known
STEP = "h"
TOLERANCE = "tol"
CLEAR = 100.0  # times rounding: an error that rounding cannot have made


def rounding(
    h: np.ndarray | Sequence[float], scale: float = 1.0, span: float = 1.0, accuracy: str = STEP
) -> np.ndarray:
    """Estimate the errors that rounding alone can make: scale (1e-12 + eps span / h), h (k,).

    h (k,): step sizes; scale: size of the states, in their unit; span: length of the run, in the
    unit of h; accuracy: what h is. Only a step says how many additions a run made: of a tolerance,
    or of 1/k of a penalty, the first part is left, scale 1e-12. Returns the floor of the error of
    each h, (k,), in the unit of scale; points of a ladder below it say nothing about the order.

    The second part is the worst case of span / h additions, each half a unit off in the same
    direction (it happens: with a constant drift every step is rounded alike). The first covers
    roots and small linear solves, which leave thousands of eps.
    """
    h = np.asarray(h, float)
    additions = span / h if accuracy == STEP else np.zeros_like(h)
    return scale * (1e-12 + EPS * additions)


def left_open(h: np.ndarray | Sequence[float], scale: float, accuracy: str) -> np.ndarray:
    """Return the errors that a method leaves open by its accuracy: scale h of a tolerance h (k,).

    An error below has met its tolerance, relative to the size of the solution, and may lie anywhere
    below. Steps and stiffnesses decide the error and leave nothing open: 0.
    """
    h = np.asarray(h, float)
    return scale * h if accuracy == TOLERANCE else np.zeros_like(h)


def clean_points(
    h: np.ndarray | Sequence[float], err: np.ndarray | Sequence[float]
) -> tuple[np.ndarray, np.ndarray, dict[str, int]]:
    """Sort the points by step, drop what is not finite, and reduce them to one per step.

    h, err (k,). A number whose square, or that of whose reciprocal for a step, is infinite counts
    as not finite: least squares and quotients of steps cannot hold it. Returns h, err, and the
    counts of what was dropped, by reason. Raises ValueError if the numbers of steps and errors
    differ.
    """
    h = np.asarray(h, float).ravel()
    err = np.abs(np.asarray(err, float).ravel())
    if h.shape != err.shape:
        raise ValueError(f"{h.size} steps and {err.size} errors")
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        good = (h > 0) & np.isfinite(np.square(h)) & np.isfinite(np.square(1.0 / h))
        good &= np.isfinite(np.square(err))
    h = h[good]
    err = err[good]
    bad = int((~good).sum())
    order = np.argsort(h, kind="stable")
    h = h[order]
    err = err[order]
    new = np.ones(len(h), bool)
    new[1:] = np.diff(h) > 1e-12 * h[1:]
    return (
        h[new],
        err[new],
        {"not finite": bad, "same step": int((~new).sum()), "floor": 0, "apart": 0, "head": 0},
    )


def above_floor(err: np.ndarray, floor: np.ndarray | float) -> np.ndarray:
    """Select the points of err (k,) above the floor.

    All finer steps are dropped once the running median of five is below, and so are deep dips. A
    single error somewhat below the floor stays: dropping low ones and keeping high ones would bend
    the fine end.
    """
    ratio = err / floor
    n = len(err)
    width = min(5, n | 1)
    lo = np.clip(np.arange(n) - width // 2, 0, max(n - width, 0))
    middle = np.array([np.median(ratio[k : k + width]) for k in lo])
    below = np.flatnonzero(middle <= 1.0)
    keep = ratio > DIP
    if below.size:
        keep[: below[-1] + 1] = False
    return keep


def now_and_then(err: np.ndarray, noise: np.ndarray) -> int:
    """Count the steps whose err (k,) is exact to rounding although a finer one is clearly not."""
    clear = np.flatnonzero(err > CLEAR * noise)
    return int((err[clear[0] :] <= noise[clear[0] :]).sum()) if clear.size else 0


def dyadic(h: np.ndarray) -> bool:
    """Do the steps h (k,) sit at fewer than 3 phases of log2 h?

    Such a ladder can see the same phase at every step.
    """
    phases = 0
    last = -1.0
    for phase in np.sort(np.log2(h) % 1.0):
        if phase > last + PHASE:
            phases = phases + 1
            last = phase
    return phases < 3


def outliers(h: np.ndarray, err: np.ndarray) -> np.ndarray:
    """Mark errors err (k,) far off a cubic through the others, one in ten at most.

    In log-log, by studentised residuals with Bonferroni's correction. A cubic follows a head, a
    plateau or a turn; what it cannot follow is one step, or some, with another behaviour.
    """
    from scipy.special import stdtrit

    out = np.zeros(len(h), bool)
    while out.sum() < len(h) // 10:
        rest = np.flatnonzero(~out)
        n = len(rest)
        if n < 12:
            break
        v = np.log(h[rest] / h[rest[0]])
        Q, _ = np.linalg.qr(np.vander(2 * v / v[-1] - 1, 4))
        y = np.log(err[rest])
        r = y - Q @ (Q.T @ y)
        free = 1.0 - np.einsum("ij,ij->i", Q, Q)
        without = (r @ r - r * r / free) / (n - 5)  # variance when the point is left out
        t = np.abs(r) / np.sqrt(np.maximum(free * without, (8 * EPS) ** 2))
        k = int(np.argmax(t))
        # a factor below two is scatter, however small the scatter of the others is
        if t[k] < stdtrit(n - 5, 1 - APART / (2 * n)) or abs(r[k]) / free[k] < np.log(2.0):
            break
        out[rest[k]] = True
    return out


def binned(
    h: np.ndarray, err: np.ndarray, statistic: Callable, per_octave: int = 1
) -> tuple[np.ndarray, np.ndarray]:
    """Reduce the points to one (h, err) per bin of log2 h.

    statistic: np.median, or np.max for the largest error, at the step where it occurs.
    """
    bins = np.floor(per_octave * np.log2(h / h[0]) + 1e-9).astype(int)
    groups = [np.flatnonzero(bins == k) for k in np.unique(bins)]
    if statistic is np.max:
        best = [g[np.argmax(err[g])] for g in groups]
        return h[best], err[best]
    return tuple(np.exp([np.median(np.log(a[g])) for g in groups]) for a in (h, err))
