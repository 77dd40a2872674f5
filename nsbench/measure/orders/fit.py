"""Fit of the order p and the constant M of err ~ M h^p to a ladder of steps.

The outcome has a 95 % interval, the window of steps that was used and a verdict in words. Questions
are asked in this order: are all errors rounding, are too few above the reference's floor, does the
error level off (`plateau`), does it grow, and last, which power law with a correction term fits
(`corrected_power_law`)?

Non-finite errors are left out, equal steps counted once. Steps where the running median of five
errors is below the floor, and deep dips below it, are dropped; so are single errors far from all
others (at most one in ten).

The order is the p of M h^p (1 + r h^q)^s: a line through all points holds its order only if there
is no head (the coarse part, where the correction is large). Points are dropped from the coarse end
while a bend is left over (t-test at 1 %) or where that makes the interval half as wide. "order"
needs 6 octaves and 18 steps, not all of a dyadic ladder, a window of 3 octaves and 8 points, a head
that has decayed at the finest step, an interval no wider than 1, and that a plateau fits worse.
Where all errors scatter too much, the largest per half octave are tried.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from nsbench.measure.orders.corrected_power_law import CorrectedPowerLaw, fit_corrected
from nsbench.measure.orders.plateau import cannot_exclude, claimed
from nsbench.measure.orders.slopes import Fit, describe_slopes, fit_line, fit_slope
from nsbench.measure.orders.window import (
    STEP,
    above_floor,
    binned,
    clean_points,
    dyadic,
    now_and_then,
    outliers,
    rounding,
)

LADDER = 6.0  # octaves of steps for a verdict
# for a verdict: 3 per octave of the shortest ladder (divisors of a spacing are few at first)
STEPS = 18
WINDOW = 3.0  # octaves the fit window keeps at least
FEWEST = 8  # points it keeps at least: 5 degrees of freedom for the interval
CURVED = 0.01  # level of the test for a bend that the head does not explain
# a drift of the slope over the window that may stay: a tenth of the half between orders
DRIFT = 0.05
SMOOTH = 1e-6  # a drift that no interval shows
CROWD = 3  # steps per half octave for the order of the largest errors
WIDE = 1.0  # width of an interval that names no order any more: orders differ by halves
FLAT = 0.1  # slopes below are no convergence one can see: 6 octaves gain a factor 1.5
ENDS = 2.0  # octaves of the fine end
SOME = 0.1  # share of the steps that may be exact by luck before one speaks of two behaviours


def fit_order(
    h: np.ndarray | Sequence[float],
    err: np.ndarray | Sequence[float],
    floor: float = 0.0,
    reference_error: float = 0.0,
    *,
    scale: float = 1.0,
    span: float = 1.0,
    accuracy: str = STEP,
    multipliers_unique: bool = True,
    reaction: Fit | None = None,
) -> Fit:
    """Fit the order of the errors `err` (k,) in the steps taken `h` (k,), any order of the two.

    floor: errors below say nothing (ten times the reference's error, when the caller has that
    already). reference_error: its own error. scale, span, accuracy: size of the solution, length of
    time, and what `h` is, for `rounding`. multipliers_unique: False forbids a plateau (the error
    compares a selection). reaction: the fit of the reaction's error, which must level off too; None
    where `err` is of state, reaction or impulse. ValueError if `h` and `err` differ in length.

    >>> import numpy as np
    >>> h = 0.1 / np.unique(np.round(2 ** np.arange(0, 8, 0.3)))
    >>> fit = fit_order(h, 3 * h**2)
    >>> fit.verdict, round(fit.order, 6), round(fit.constant, 6)
    ('order', 2.0, 3.0)
    """
    h, err, dropped = clean_points(h, err)
    ladder = float(np.log2(h[-1] / h[0])) if len(h) > 1 else 0.0
    base = Fit(octaves=ladder, dropped=dropped)
    if len(h) < 3:
        few = f"{len(h)} usable steps"
        said = f"{few}: no order from fewer than 3."
        return replace(base, reason=f"{few}; 3 are needed", sentence=said)
    noise = rounding(h, scale, span, accuracy)
    if np.all(err <= noise):
        return replace(
            base,
            verdict="exact: no order",
            reason="all errors are rounding",
            sentence=f"Exact at the samples: all errors are rounding (at most {err.max():.1e}); "
            f"no order.",
        )
    known = max(float(floor), 10.0 * float(reference_error))
    mixed = _mixed_behaviour(err, noise)
    keep = above_floor(err, np.maximum(known, noise))
    dropped["floor"] = int((~keep).sum())
    if keep.sum() < 3:
        return _too_few_above(err, noise, known, int(keep.sum()), mixed, base)
    why, phase = _reason_for_no_verdict(h, ladder, mixed)
    h = h[keep]
    err = err[keep]
    apart = outliers(h, err)
    dropped["apart"] = int(apart.sum())
    h = h[~apart]
    err = err[~apart]
    line = fit_line(h, err, base)
    # a plateau bends like a slow start, divergence like neither: asked in this order
    fit = _levels_off(h, err, line, known, why, multipliers_unique, reaction)
    fit = fit or (None if phase else _diverges(h, line)) or _power(h, err, line, known, why)
    return replace(fit, sentence=f"{fit.sentence}{describe_slopes(fit)}")


def _reason_for_no_verdict(h, ladder: float, mixed: str) -> tuple[str, bool]:
    """Explain why no verdict can be given, "" if one can.

    Returns (reason, whether the phase of the steps is behind it).
    """
    few = f"{ladder:.1f} octaves with {len(h)} steps; {LADDER:g} with {STEPS} are needed"
    short = ladder < LADDER - 1e-9
    if dyadic(h):
        turns = "an error that turns with the phase of the step looks constant"
        return few if short else f"the steps are dyadic: {turns}", True
    if mixed:
        return mixed, True
    return few if short or len(h) < STEPS else "", False


def _mixed_behaviour(err, noise) -> str:
    """Explain why there is no verdict where many, but not all, steps are exact to rounding.

    Elsewhere "".
    """
    lucky = now_and_then(err, noise)
    if lucky <= max(1.0, SOME * len(err)):
        return ""
    return (
        f"exact to rounding at {lucky} of {len(err)} steps, off by up to {err.max():.1e} at "
        "others: which of the two depends on the step"
    )


def _too_few_above(err, noise, known: float, above: int, mixed: str, base: Fit) -> Fit:
    """Return the verdict where fewer than three errors lie above the floor and above rounding."""
    below = np.count_nonzero(err <= known) > np.count_nonzero(err <= noise)
    verdict, limit = (
        ("below reference", "ten times the reference's error")
        if below
        else ("undecided", "rounding")
    )
    few = f"only {above} errors lie above {limit} ({max(known, noise[0]):.1e})"
    return replace(
        base,
        verdict=verdict,
        points=above,
        reason=mixed or few,
        sentence=f"No verdict ({mixed})." if mixed else f"{_capital(few)}: no order.",
    )


def _capital(text: str) -> str:
    """Begin a sentence with these words."""
    return text[:1].upper() + text[1:]


def _levels_off(h, err, line: Fit, known, why, unique, reaction) -> Fit | None:
    """Return a fit with the verdict where the error levels off; None where it does not.

    Where a plateau is not claimed, the fit has the reason why as its sentence.
    """
    # flat: hardly any slope fits as well, and nothing steeper than 0.2 does
    # (nor does the fine end fall: an error that saturates at coarse steps is flat there only)
    end = h <= h[0] * 2.0**ENDS
    flat = (
        abs(line.order) <= FLAT
        and line.interval[0] <= FLAT / 2
        and line.interval[1] < 2 * FLAT
        and not fit_slope(h[end], err[end])[1][0] > FLAT
    )
    if flat:
        C = float(np.exp(np.log(err).mean()))
        order = 0.0
        constant = np.nan
    else:
        full = claimed(h, err) if len(h) >= FEWEST else None
        if full is None:
            return None
        C = full.C
        order = full.p
        constant = full.M
    seen = f"the error levels off near {C:.1e}"
    reasons = [
        text
        for bad, text in (
            (bool(why), why),
            (known >= C, "that is within ten times the reference's own error"),
            (not unique, "the multipliers are not unique: a selection, not an error"),
            (
                reaction is not None and reaction.verdict != "plateau",
                "the reaction does not level off",
            ),
        )
        if bad
    ]
    if reasons:
        doubt = f"{seen}, but no plateau is claimed: {'; '.join(reasons)}"
        return replace(line, reason=doubt, sentence=f"{_capital(doubt)}.")
    return replace(
        line,
        verdict="plateau",
        plateau=C,
        order=order,
        constant=constant,
        reason=seen,
        sentence=f"{_capital(seen)}: a plateau, rejected as a power law at 0.1 %."
        if not flat
        else f"{_capital(seen)} for all {len(h)} steps: it does not fall with the step.",
    )


def _settle(h, err, known) -> tuple[int, CorrectedPowerLaw | None, bool]:
    """Drop points from the coarse end while a bend is left over.

    A head of another shape is no scatter, and less of it is better: a shorter window is taken at
    once if its interval is less than half as wide. (From scatter alone a shorter window is wider,
    by the power 3/2 of its length and more.) Returns (number of points left, their fit, whether the
    bend is gone).
    """
    from scipy.special import stdtrit

    n = len(h)
    if n < FEWEST:
        return n, None, False
    u = np.log(h)
    y = np.log(err)
    own = known / 10.0 / err
    fit = fit_corrected(u, y, own)
    strict = False
    allowed = [k for k in range(FEWEST, n) if u[k - 1] - u[0] >= WINDOW * np.log(2.0) - 1e-9]
    if allowed and abs(fit.drift) > SMOOTH:
        some = sorted({allowed[round(k * (len(allowed) - 1))] for k in (0.0, 0.33, 0.67)})
        tried = [(k, fit_corrected(u[:k], y[:k], own[:k])) for k in some]
        at = min(range(len(some)), key=lambda i: tried[i][1].half)
        # how far the order of the next window lies is what the misfit may still do to this one
        beside = [
            abs(tried[at][1].p - tried[i][1].p) for i in (at - 1, at + 1) if 0 <= i < len(some)
        ]
        half = tried[at][1].half + min(beside, default=0.0)
        if tried[at][1].half < fit.half / 2 and half < fit.half:
            n = some[at]
            fit = replace(tried[at][1], half=half)
    while True:
        strict = strict or fit.bend > stdtrit(n - 4, 1.0 - CURVED / 2)
        # one level to believe in a bend, another that it is gone: stopping at the first would leave
        # a bias of its size
        gone = not strict or fit.bend < 1.0 or abs(fit.drift) <= DRIFT
        if gone or n - 1 not in allowed:
            return n, fit, gone
        n -= 1
        fit = fit_corrected(u[:n], y[:n], own[:n])


def _diverges(h, line: Fit) -> Fit | None:
    """Return the verdict where the plain slope of at least five errors is negative; else None.

    Divergence needs no long ladder.
    """
    lo, hi = line.interval
    if hi >= 0.0 or line.order >= -FLAT or len(h) < 5:
        return None
    return replace(
        line,
        verdict="diverges",
        reason="the error grows as the step shrinks",
        sentence=f"The error grows as the step shrinks: slope {line.order:.3f} "
        f"[{lo:.3f}, {hi:.3f}] from {len(h)} steps in [{h[0]:.2e}, {h[-1]:.2e}].",
    )


def _power(h, err, line: Fit, known: float, why: str) -> Fit:
    """Drop points that no head explains, then decide whether the rest shows an order."""
    n, headed, settled = _settle(h, err, known)
    fit = line
    if headed is not None:
        widen = abs(headed.drift) / 2 if n < len(h) else 0.0
        half = headed.half + widen
        share = float(np.expm1(abs(headed.head[-1])))
        fit = replace(
            fit_line(h[:n], err[:n], line),
            order=headed.p,
            interval=(float(headed.p - half), float(headed.p + half)),
            constant=float(np.exp(headed.a) / h[n - 1] ** headed.p),
            head=share,
            dropped={**line.dropped, "head": len(h) - n},
            median=line.median,
            envelope=line.envelope,
            median_interval=line.median_interval,
            envelope_interval=line.envelope_interval,
        )
    lo, hi = fit.interval
    said = (
        f"slope {fit.order:.3f} [{lo:.3f}, {hi:.3f}] from {fit.points} steps in [{h[0]:.2e}, "
        f"{h[n - 1]:.2e}]"
    )
    if not why and (headed is None or np.log2(h[n - 1] / h[0]) < WINDOW - 1e-9):
        why = (
            f"{np.log2(h[n - 1] / h[0]):.1f} octaves with {n} steps above the floor; {WINDOW:g} "
            f"with {FEWEST} are needed"
        )
    if why:
        return replace(fit, reason=why, sentence=f"No verdict ({why}): {said}.")
    if not settled or headed.edge:
        return replace(
            fit,
            verdict="pre-asymptotic",
            reason="the local slope still drifts",
            sentence=f"The local slope still drifts: {said}.",
        )
    if hi - lo > WIDE:
        doubt = f"the interval is wider than {WIDE:g}: more steps are needed"
    elif lo <= 2 * FLAT:
        doubt = "so slow that a logarithm, or no convergence, fits as well"
    elif cannot_exclude(h[:n], err[:n]) and cannot_exclude(
        *binned(h[:n], err[:n], np.max, 2), head=False
    ):
        doubt = "a plateau fits as well: more or finer steps are needed"
    else:
        return replace(
            fit, verdict="order", sentence=f"Order: {said}, constant {fit.constant:.3g}."
        )
    undecided = replace(fit, reason=doubt, sentence=f"No verdict ({doubt}): {said}.")
    return _bounded(h, err, fit) or undecided


def _bounded(h, err, fit: Fit) -> Fit | None:
    """Fit the order of the largest errors per half octave; None where they show none.

    For errors that together scatter too much for one: errors that turn with the phase of the step
    fall to zero between; what converges is their bound. Needs several steps in each half octave, or
    the largest is as much a matter of luck.
    """
    top, most = binned(h, err, np.max, 2)
    if len(top) < max(FEWEST, 2 * WINDOW) or len(h) < CROWD * len(top):
        return None
    found = fit_corrected(np.log(top), np.log(most))
    lo = float(found.p - found.half)
    hi = float(found.p + found.half)
    bent = found.edge or (abs(found.drift) > DRIFT and found.bend > 2.0)
    if bent or lo <= 2 * FLAT or hi - lo > WIDE / 2 or cannot_exclude(top, most):
        return None
    constant = float(np.exp(found.a) / top[-1] ** found.p)
    return replace(
        fit,
        verdict="order",
        order=found.p,
        interval=(lo, hi),
        constant=constant,
        points=len(h),
        window=(float(h[0]), float(h[-1])),
        dropped={**fit.dropped, "head": 0},
        head=float(np.expm1(abs(found.head[-1]))),
        sentence=f"Order of the largest error per half octave: slope {found.p:.3f} [{lo:.3f}, "
        f"{hi:.3f}] from "
        f"{len(h)} steps in [{h[0]:.2e}, {h[-1]:.2e}], constant {constant:.3g}; the errors turn "
        f"with "
        "the phase of the step.",
    )
