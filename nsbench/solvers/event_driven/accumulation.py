"""Detect events that accumulate at a finite time (Zeno behaviour).

Intervals between events that shrink like a geometric series end at a known time, which no method
that follows events can pass. Many contacts may close at one instant without accumulation, so for
contacts the test is a count of events within a short span.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

WINDOW = 3  # events per window whose lengths are compared
MAX_RATIO = 0.9  # of the lengths of two windows: above, a geometric series is not certain
REACHED = 1e-10  # part of the run: what is left of the series when the run stops
# Events within one instant, besides two for each closed contact, that count as accumulation.
MAX_EVENTS_AT_ONE_INSTANT = 100
INSTANT = 1e-10  # part of the run that counts as one instant


def accumulation(
    times: Sequence[float], span: float, reached: float = REACHED
) -> float | None:
    """Return the time at which the events accumulate once it is all but reached, else None.

    times: of the events, ascending. span: the own time of the case. The run should stop when the
    rest of the geometric series is below `reached` of the span, or when times no longer differ
    beyond rounding.
    """
    if len(times) <= 2 * WINDOW:
        return None
    last = times[-1] - times[-1 - WINDOW]
    before = times[-1 - WINDOW] - times[-1 - 2 * WINDOW]
    if last + before <= 16 * np.spacing(abs(times[-1])):
        return times[-1]
    ratio = last / before if before > 0.0 else 1.0
    if ratio < MAX_RATIO and last * ratio / (1.0 - ratio) <= reached * span:
        return times[-1] + last * ratio / (1.0 - ratio)
    return None


def crowded_events(
    times: Sequence[float], now: float, span: float, max_closed: int
) -> tuple[int, float] | None:
    """Return (events, length) if so many events fell within so short a time, else None.

    times: of the events. now: current time. span: the own time of the case. max_closed: most
    contacts that were closed at once, each of which may close and open at one instant.
    """
    limit = MAX_EVENTS_AT_ONE_INSTANT + 2 * max_closed
    instant = INSTANT * span
    if len(times) > limit and now - times[-limit] < instant:
        return limit, instant
    return None
