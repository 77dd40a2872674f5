"""Extend ladders of accuracies until an asked-for error is reached, or would cost too much.

A ladder ends where it ends; whether a method reaches an error is then not known, though its order
tells which step would. `further_runs` adds the steps up to that one, where the seconds that they
are expected to take stay within a budget.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable

import numpy as np

from nsbench.report.cost import cost_at_error, expect_cost
from nsbench.report.data import build, columns_of
from nsbench.report.style import join_names
from nsbench.report.summary import Summary, summarise
from nsbench.study import Spec
from nsbench.study.plan import resolve

MARGIN = 0.8  # of the step that the order tells: the error must lie below the asked one
MOST_STEPS = 8  # added to a ladder at once
PER_OCTAVE = 3  # steps, as in a standard ladder
ROUNDS = 3  # of additions: an order may turn out different further down


def further_runs(
    specs: list[Spec], rows: Iterable[dict], target: float, budget: float
) -> list[Spec]:
    """Return the runs that carry ladders on to the state error `target`.

    budget: seconds that the added runs of one method on one case may take, as extrapolated.
    """
    by_pair: dict[tuple, list[Spec]] = {}
    for spec in specs:
        if math.isfinite(spec.asked) and not spec.start_seed:
            by_pair.setdefault((spec.case, spec.solver), []).append(spec)
    out = []
    for pair, summary in summarise(build(columns_of(rows))).items():
        if pair in by_pair:
            out += _of_pair(by_pair[pair], summary, target, budget)
    return out


def describe_unreached(rows: Iterable[dict], target: float, budget: float) -> list[str]:
    """Say which methods do not reach the state error `target`, and why they were not carried on."""
    reasons: dict[str, list[str]] = {}
    for (case, solver), summary in summarise(build(columns_of(rows))).items():
        known = np.isfinite(summary.runs.col["state_sup"][summary.runs.good]).any()
        if not known or cost_at_error(summary.runs, target) is not None:
            continue
        is_clear = expect_cost(summary, target) is not None
        why = (
            f"in {ROUNDS} rounds and {budget:g} s of a method on a case (--budget)"
            if is_clear
            else "their orders are not clear enough to tell a step"
        )
        reasons.setdefault(why, []).append(f"{solver} on {case}")
    return [
        f"error {target:g} not reached by {join_names(names, 4)}: {why}"
        for why, names in reasons.items()
    ]


def _of_pair(specs: list[Spec], summary: Summary, target: float, budget: float) -> list[Spec]:
    cost = expect_cost(summary, target)
    if cost is None:
        return []
    runs = summary.runs
    finest = float(runs.col["h"][runs.good & (runs.col["h"] > 0.0)][-1])
    last = MARGIN * cost.h
    count = min(MOST_STEPS, max(2, math.ceil(PER_OCTAVE * math.log2(finest / last))))
    steps = np.geomspace(finest, last, count + 1)[1:]
    # the finest run takes most of the seconds; coarser ones a geometric series of it
    expected = cost.seconds / MARGIN / (1.0 - float(steps[-1] / steps[-2]))
    if not expected <= budget:
        return []
    known = {spec.asked for spec in specs}
    asked = (_asked(specs[0], float(h)) for h in steps)
    return [dataclasses.replace(specs[0], asked=a) for a in asked if a not in known]


def _asked(spec: Spec, h: float) -> float:
    """Return the accuracy to ask for: a step of a grid over the samples, or k = 1/h."""
    if spec.accuracy == "k":
        return float(f"{1.0 / h:.3g}")
    spacing = float(np.diff(resolve(spec.case, spec.file, spec.references).t).min())
    return spacing / math.ceil(spacing / h)
