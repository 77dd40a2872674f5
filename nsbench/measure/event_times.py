"""Errors of event times: matching of the events of a run with those of the reference."""

from __future__ import annotations

import numpy as np

from nsbench.problem import Problem
from nsbench.reference import canonical
from nsbench.trajectory import Event


def match(found: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Match increasing times found (a,) and wanted (b,); return the differences of the pairs.

    As many pairs as the shorter sequence has, in order, with the least sum of differences (dynamic
    programming over prefixes).
    """
    if len(found) > len(wanted):
        found, wanted = wanted, found
    m = len(found)
    n = len(wanted)
    if m == 0:
        return np.empty(0)
    cost = np.full((m + 1, n + 1), np.inf)
    cost[0] = 0.0
    gap = np.abs(found[:, None] - wanted[None, :])
    for i in range(m):
        for j in range(i, n - (m - 1 - i)):
            cost[i + 1, j + 1] = min(cost[i + 1, j], cost[i, j] + gap[i, j])
    out = []
    j = n
    for i in range(m, 0, -1):
        while cost[i, j] == cost[i, j - 1]:
            j -= 1
        out.append(gap[i - 1, j - 1])
        j -= 1
    return np.array(out[::-1])


def event_errors(
    problem: Problem, found: tuple[Event, ...], wanted: tuple[Event, ...]
) -> tuple[float, int, int]:
    """Match the events of a run with those of the reference.

    Returns the largest difference of matched times (NaN without any), the number of reference
    events that were missed, and the number of events too many.

    Events are matched within one kind and contact; a pivot is none: it changes the basis among
    redundant contacts, which is a selection; reference times of unknown kind with any event, and
    then no event counts as one too many (several contacts may close at one such time).
    """
    found, wanted = ([e for e in events if e.kind != "pivot"] for events in (found, wanted))
    if any(not e.kind for e in wanted):
        times = np.unique([e.t for e in found])
        goals = np.unique([e.t for e in wanted])
        diffs = match(times, goals) if len(times) >= len(goals) else match(goals, times)
        return _largest(diffs), max(len(goals) - len(times), 0), 0
    keys = {(e.kind, canonical(problem, e.contact)) for e in (*found, *wanted)}
    worst = np.nan
    missed = 0
    extra = 0
    for key in keys:
        a, b = (
            np.sort([e.t for e in events if (e.kind, canonical(problem, e.contact)) == key])
            for events in (found, wanted)
        )
        worst = np.fmax(worst, _largest(match(a, b)))
        missed = missed + max(len(b) - len(a), 0)
        extra = extra + max(len(a) - len(b), 0)
    return float(worst), missed, extra


def _largest(values) -> float:
    """Return the largest value, NaN if there is none."""
    return float(values.max()) if len(values) else float("nan")
