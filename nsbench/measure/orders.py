"""Orders and constants: err ~ M h^p from a ladder of steps, with an interval, a window and a verdict in words."""
from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from nsbench.measure.plateau import Levelled, cannot_exclude, fit_levelled, persists, power_law

VERDICTS = ("order", "exact: no order", "plateau", "pre-asymptotic", "undecided", "diverges", "below reference")
LADDER = 6.0            # octaves of steps for a verdict
STEPS = 18              # for a verdict: 3 per octave of the shortest ladder (divisors of a spacing are few at first)
WINDOW = 3.0            # octaves the fit window keeps at least
FEWEST = 8              # points it keeps at least: 6 degrees of freedom for the slope's interval
CURVED = 0.05           # level of the test for a drift of the local slope
DRIFT = 0.05            # a drift of the slope over the window that may stay: a tenth of the half between orders
FLAT = 0.1              # slopes below are no convergence one can see: 6 octaves gain a factor 1.5
EPS = float(np.finfo(float).eps)


@dataclass(frozen=True)
class Fit:
    """The outcome of `fit_order`.

    order: slope of log err over log h in the window (negative: diverges; NaN: none); interval: its 95 % interval;
    constant: M of err = M h^order; verdict: one of VERDICTS; window: (smallest, largest) step used; points: how many;
    median, envelope: slopes of the medians and of the maxima per octave; plateau: C of C + M h^p where claimed;
    dropped: points left out, by reason; octaves: of the whole ladder; sentence: all this for a reader.
    """
    order: float = np.nan
    interval: tuple[float, float] = (np.nan, np.nan)
    constant: float = np.nan
    verdict: str = "undecided"
    window: tuple[float, float] = (np.nan, np.nan)
    points: int = 0
    median: float = np.nan
    envelope: float = np.nan
    plateau: float = np.nan
    octaves: float = 0.0
    dropped: dict | None = None
    sentence: str = ""


def rounding(h, scale: float = 1.0, span: float = 1.0) -> np.ndarray:
    """Errors that rounding alone can make: scale (1e-12 + eps span / h).

    The second part is the worst case of span / h additions, each half a unit off in the same direction (it happens:
    with a constant drift every step is rounded alike). The first covers roots and small linear solves, which leave
    thousands of eps.
    """
    return scale * (1e-12 + EPS * span / np.asarray(h, float))


def fit_order(h, err, floor: float = 0.0, reference_error: float = 0.0, *, scale: float = 1.0, span: float = 1.0,
              multipliers_unique: bool = True, reaction: Fit | None = None) -> Fit:
    """The order of the errors `err` (k,) in the steps taken `h` (k,).

    floor: errors below say nothing (ten times the reference's error, when the caller has that already);
    reference_error: the reference's own error; scale, span: size of the solution and length of time, for `rounding`.
    multipliers_unique: False forbids a plateau (the error compares a selection). reaction: the fit of the reaction's
    error, which must level off too; None where `err` is itself of the state, the reaction or the impulse.

    Rules. Non-finite errors are counted out, equal steps kept once. Steps where the running median of five errors is
    below the floor, and single errors below it, are dropped. The head is dropped from the coarse end, point by point,
    while a quadratic in log h shows a drift of the local slope (t-test at 5 %) larger than 0.05 over the window; half
    of a significant drift that stays widens the interval. "order" needs 6 octaves and 18 steps, not all of a
    dyadic ladder, and a window of 3 octaves and 8 points.

    >>> import numpy as np
    >>> h = 0.1 / np.unique(np.round(2 ** np.arange(0, 8, 0.3)))
    >>> fit = fit_order(h, 3 * h**2)
    >>> fit.verdict, round(fit.order, 6), round(fit.constant, 6)
    ('order', 2.0, 3.0)
    """
    h, err, dropped = _clean(h, err)
    ladder = float(np.log2(h[-1] / h[0])) if len(h) > 1 else 0.0
    base = Fit(octaves=ladder, dropped=dropped)
    if len(h) < 3:
        return replace(base, sentence=f"{len(h)} usable steps: no order from fewer than 3.")
    noise = rounding(h, scale, span)
    if np.all(err <= noise):
        return replace(base, verdict="exact: no order",
                       sentence=f"Exact at the samples: all errors are rounding (at most {err.max():.1e}); no order.")
    known = max(float(floor), 10.0 * float(reference_error))
    keep = _above(err, np.maximum(known, noise))
    dropped["floor"] = int((~keep).sum())
    if keep.sum() < 3:
        below = np.count_nonzero(err <= known) > np.count_nonzero(err <= noise)
        verdict, what = ("below reference", "ten times the reference's error") if below else ("undecided", "rounding")
        return replace(base, verdict=verdict, points=int(keep.sum()),
                       sentence=f"Only {keep.sum()} errors lie above {what} ({max(known, noise[0]):.1e}): no order.")
    enough = ladder >= LADDER - 1e-9 and len(h) >= STEPS and not _dyadic(h)
    h, err = h[keep], err[keep]
    line = replace(_line(h, err, base), median=_slope(*_binned(h, err, np.median)),
                   envelope=_slope(*_binned(h, err, np.max)))
    verdict = _levels_off(h, err, line, known, enough, multipliers_unique, reaction)
    return verdict or _power(h, err, line, enough)


def _clean(h, err):
    """Sorted, finite, one point per step: (h, err, counts of what was dropped)."""
    h, err = np.asarray(h, float).ravel(), np.abs(np.asarray(err, float).ravel())
    if h.shape != err.shape:
        raise ValueError(f"{h.size} steps and {err.size} errors")
    good = np.isfinite(h) & (h > 0) & np.isfinite(err)
    h, err, bad = h[good], err[good], int((~good).sum())
    order = np.argsort(h, kind="stable")
    h, err = h[order], err[order]
    new = np.ones(len(h), bool)
    new[1:] = np.diff(h) > 1e-12 * h[1:]
    return h[new], err[new], {"not finite": bad, "same step": int((~new).sum()), "floor": 0, "head": 0}


def _above(err, floor) -> np.ndarray:
    """Points above the floor: single dips are dropped, and all finer steps once the running median of five is below."""
    keep = err > floor
    n, width = len(err), min(5, len(err) | 1)
    for k in range(n - 1, -1, -1):                               # from the coarse end
        lo = max(0, k - width // 2)
        hi = min(n, lo + width)
        lo = max(0, hi - width)
        if np.median(err[lo:hi] / floor[lo:hi]) <= 1.0:
            if err[k] <= floor[k]:
                keep[:k + 1] = False
                break
    return keep


def _dyadic(h) -> bool:
    """True when the steps sit at fewer than 3 phases of log2 h: such a ladder can see the same phase at every step."""
    phases, last = 0, -1.0
    for phase in np.sort(np.log2(h) % 1.0):
        if phase > last + 0.02:
            phases, last = phases + 1, phase
    return phases < 3


def _line(h, err, fit: Fit, widen: float = 0.0) -> Fit:
    """The straight line through log err: order, t-based 95 % interval, constant, window."""
    from scipy.special import stdtrit
    u, y, n = np.log(h), np.log(err), len(h)
    a, p, rss = power_law(u, y)
    half = np.inf
    if n > 2:
        half = float(stdtrit(n - 2, 0.975)) * np.sqrt(rss / (n - 2) / np.sum((u - u.mean()) ** 2)) + widen
    return replace(fit, order=p, interval=(float(p - half), float(p + half)), constant=float(np.exp(a)), points=n,
                   window=(float(h[0]), float(h[-1])))


def _binned(h, err, statistic, per_octave: int = 1):
    """One (h, err) per bin of log2 h: medians, or the largest error at the step it was met."""
    bins = np.floor(per_octave * np.log2(h / h[0]) + 1e-9).astype(int)
    groups = [np.flatnonzero(bins == k) for k in np.unique(bins)]
    if statistic is np.max:
        best = [g[np.argmax(err[g])] for g in groups]
        return h[best], err[best]
    return tuple(np.exp([np.median(np.log(a[g])) for g in groups]) for a in (h, err))


def _slope(h, err) -> float:
    """NaN with fewer than three bins."""
    return power_law(np.log(h), np.log(err))[1] if len(h) >= 3 else float("nan")


def _levels_off(h, err, line: Fit, known, enough, unique, reaction) -> Fit | None:
    """A verdict where the error levels off (or the reason why a plateau is not claimed); None where it does not."""
    # flat: hardly any slope fits as well, and nothing steeper than 0.2 does
    flat = abs(line.order) <= FLAT and line.interval[0] <= FLAT / 2 and line.interval[1] < 2 * FLAT
    level = Levelled(float(np.exp(np.log(err).mean())), 0.0, 0.0, 0.0, 0.0, len(h)) if flat else None
    if not flat:
        if len(h) < FEWEST:
            return None
        level = fit_levelled(h, err)
        if not (level.C > 0.0 and level.significant and persists(h, err, level)):
            return None
    seen = f"The error levels off near {level.C:.1e}"
    reasons = [text for bad, text in (
        (not enough, "the ladder is too short, too sparse or dyadic for a verdict"),
        (level.C <= known, "that is within ten times the reference's own error"),
        (not unique, "the multipliers are not unique: a selection, not an error"),
        (reaction is not None and reaction.verdict != "plateau", "the reaction does not level off"),
    ) if bad]
    if reasons:
        return replace(line, sentence=f"{seen}, but no plateau is claimed: {'; '.join(reasons)}.")
    order, constant = (0.0, np.nan) if flat else (level.p, level.M)
    return replace(line, verdict="plateau", plateau=level.C, order=order, constant=constant,
                   sentence=f"{seen}: a plateau, rejected as a power law at 1 %." if not flat else
                            f"{seen} for all {len(h)} steps: it does not fall with the step.")


def _power(h, err, line: Fit, enough: bool) -> Fit:
    """Drop the head, then say whether what is left shows an order."""
    n, settled, widen, head = len(h), False, 0.0, False
    while n >= 3:
        drift, t, believed = _drift(np.log(h[:n]), np.log(err[:n]))
        head = head or t > believed
        # one level to believe in a head, another that it is gone: stopping at the first would leave a bias of its size
        settled = not head or t < 1.0 or abs(drift) <= DRIFT
        if settled or n - 1 < FEWEST or np.log2(h[n - 2] / h[0]) < WINDOW:
            break
        n -= 1
    widen = abs(drift) / 2 if head else 0.0
    dropped = {**line.dropped, "head": len(h) - n}
    fit = replace(_line(h[:n], err[:n], line, widen), dropped=dropped)
    lo, hi = fit.interval
    said = f"slope {fit.order:.3f} [{lo:.3f}, {hi:.3f}] from {n} steps in [{h[0]:.2e}, {h[n - 1]:.2e}]"
    if hi < 0.0 and fit.order < -FLAT and n >= 5:
        return replace(fit, verdict="diverges", sentence=f"The error grows as the step shrinks: {said}.")
    wide = n >= FEWEST and np.log2(h[n - 1] / h[0]) >= WINDOW - 1e-9
    if not enough or not wide:
        why = (f"{line.octaves:.1f} octaves of steps; {LADDER:g} with {STEPS} steps, not dyadic, are needed"
               if not enough else f"{np.log2(h[n - 1] / h[0]):.1f} octaves above the floor; {WINDOW:g} are needed")
        return replace(fit, sentence=f"No verdict ({why}): {said}.")
    if not settled:
        return replace(fit, verdict="pre-asymptotic", sentence=f"The local slope still drifts: {said}.")
    # errors that dip with the phase of the step scatter below a clean upper envelope, which may tell what they cannot
    if lo <= 0.0 or (cannot_exclude(h[:n], err[:n]) and cannot_exclude(*_binned(h[:n], err[:n], np.max, 2))):
        return replace(fit, sentence=f"No verdict (a plateau fits as well: more or finer steps are needed): {said}.")
    return replace(fit, verdict="order", sentence=f"Order: {said}, constant {fit.constant:.3g}.")


def _drift(u, y) -> tuple[float, float, float]:
    """Change of the local slope over the window from a quadratic fit, its |t|, and the quantile of t at 5 %."""
    from scipy.special import stdtrit
    n = len(u)
    if n < 5:
        return 0.0, 0.0, np.inf
    v = (u - u.mean()) / (u[-1] - u[0])
    q = v * v
    q = q - q.mean() - v * (v @ q) / (v @ v)                     # the part of the square a line does not explain
    r = y - y.mean() - v * (v @ y) / (v @ v)
    c = float(q @ r / (q @ q))
    rest = max(float(r @ r - c * c * (q @ q)), n * (8 * EPS) ** 2)
    t = abs(c) * np.sqrt(q @ q) / np.sqrt(rest / (n - 3))
    return 2.0 * c / float(u[-1] - u[0]), float(t), float(stdtrit(n - 3, 1.0 - CURVED / 2))
