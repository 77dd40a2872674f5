"""Ladders of steps: errors of one method over many steps, and a verdict for each kind of error.

Every step divides the spacing of the samples, and ratios of steps are not dyadic. A verdict is that
of `fit_order`; "stalls" is a plateau that is claimed again when the steps go on to a quarter of the
smallest one.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable

import numpy as np

from nsbench.case import Case
from nsbench.measure import Fit, errors, fit_order
from nsbench.measure.context import MeasureContext, make_context
from nsbench.solvers import solve
from nsbench.studies.runs.finished_run import USABLE
from nsbench.studies.runs.truth import find_truth
from nsbench.study.plan import substeps_ladder

QUANTITIES = {"state": "state_sup", "impulse": "impulse", "reaction": "reaction"}
FLOORS = {"state": "state_floor", "impulse": "impulse_floor", "reaction": "reaction_floor"}
SCALES = {"state": "state_scale", "impulse": "impulse_scale", "reaction": "impulse_scale"}
STEPS_PER_OCTAVE = 3
FURTHER_OCTAVES = 2  # that a plateau must survive: h/4
STALLS = "stalls"


def context_of_truth(case: Case) -> MeasureContext:
    """Return what errors of a case are measured against: its reference or a computed one."""
    return make_context(case, find_truth(case))


def count_substeps(first: int, octaves: float) -> list[int]:
    """Return step counts between two samples over `octaves`, STEPS_PER_OCTAVE in each."""
    return substeps_ladder(first, octaves, round(octaves * STEPS_PER_OCTAVE) + 1)


def climb(case: Case, method: str, substeps: Iterable[int], context: MeasureContext) -> list[dict]:
    """Run a method with each number of steps between samples; one row of errors for each.

    Rows: {"substeps", "h", "status", "why", "state", "impulse", "reaction", floors and scales}.
    """
    spacing = float(np.diff(case.t).min())
    return [_measure(case, method, spacing / n, n, context) for n in substeps]


def _measure(case: Case, method: str, h: float, substeps: int, context: MeasureContext) -> dict:
    traj = solve(case, method, h=h)
    row = {"substeps": substeps, "h": h, "status": traj.status.code, "why": str(traj.status)}
    if traj.status.code not in USABLE:
        return row
    # error bars are not asked for here, and would cost more than the run
    found = errors(case, dataclasses.replace(traj, bound=None), context)
    for name, column in QUANTITIES.items():
        row[name] = _number(found[column])
        row[f"{name}_floor"] = _number(found[FLOORS[name]])
        row[f"{name}_scale"] = _number(found[SCALES[name]])
    return row


def _number(value: float) -> float | None:
    """Return the value, None for what JSON cannot hold."""
    return float(value) if math.isfinite(value) else None


def judge(rows: list[dict], span: float, unique: bool) -> dict[str, dict]:
    """Judge state, impulse and reaction of a ladder, by name: order, level and words.

    span: length of the run. unique: are the multipliers unique? Where not, impulses have no error
    and no verdict.
    """
    reaction = _fit(rows, "reaction", span)
    fits = {
        "state": _fit(rows, "state", span),
        "impulse": _fit(rows, "impulse", span, unique, reaction) if unique else None,
        "reaction": reaction,
    }
    return {name: _describe(fit) for name, fit in fits.items()}


def _fit(rows, name: str, span: float, unique: bool = True, reaction: Fit | None = None):
    used = [r for r in rows if r.get(name) is not None]
    if not used:
        return None
    return fit_order(
        [r["h"] for r in used],
        [r[name] for r in used],
        floor=max(r[f"{name}_floor"] or 0.0 for r in used),
        scale=max(r[f"{name}_scale"] or 1.0 for r in used),
        span=span,
        multipliers_unique=unique,
        reaction=reaction,
    )


def _describe(fit: Fit | None) -> dict:
    if fit is None:
        return {"verdict": "no error defined", "order": None, "low": None, "high": None}
    ends = (fit.order, *fit.interval)
    order, low, high = (_number(v) for v in ends)
    return {
        "verdict": fit.verdict,
        "order": order,
        "low": low,
        "high": high,
        "constant": _number(fit.constant),
        "level": _number(fit.plateau),
        "sentence": fit.sentence,
    }


def convergence(case: Case, method: str, first: int, octaves: float) -> dict:
    """Judge a method on a case over a ladder of `octaves` from `first` steps between samples.

    Where a plateau is claimed, the ladder goes on to a quarter of its smallest step; the verdict
    is "stalls" only if a plateau is claimed again. Returns rows, verdicts, truth and its bound.
    """
    context = context_of_truth(case)
    span = float(case.t[-1] - case.t[0])
    rows = climb(case, method, count_substeps(first, octaves), context)
    verdicts = judge(rows, span, bool(context.unique))
    if any(v["verdict"] == "plateau" for v in verdicts.values()):
        last = rows[-1]["substeps"]
        further = count_substeps(last, FURTHER_OCTAVES)[1:]
        rows += climb(case, method, further, context)
        verdicts = judge(rows, span, bool(context.unique))
        for verdict in verdicts.values():
            if verdict["verdict"] == "plateau":
                verdict["verdict"] = STALLS
    return {
        "case": case.key,
        "method": method,
        "rows": rows,
        "verdicts": verdicts,
        "unique": bool(context.unique),
        "truth": context.ref.kind,
        "truth_error": context.ref.state_error,
    }


def say_verdict(verdict: dict) -> str:
    """Say a verdict in a few words: the order with its interval, or what stands for it."""
    if verdict["verdict"] == "order":
        low = f"{verdict['low']:.3f}"
        return f"order {verdict['order']:.2f} [{low}, {verdict['high']:.3f}]"
    if verdict["verdict"] == STALLS:
        return f"stalls at {verdict['level']:.2g}"
    if verdict["order"] is not None and verdict["verdict"] in ("undecided", "pre-asymptotic"):
        return f"{verdict['verdict']}, slope {verdict['order']:.2f}"
    return verdict["verdict"]
