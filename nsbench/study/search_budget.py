"""Seconds that the runs of one search may take: what was spent, and what a further try would take.

Seconds grow with the fineness of single runs (nsbench.measure.cost_growth), fitted where their
accuracies span a factor SPAN. What is paid once counts for nothing: compilation is taken off, and a
quick run is made again, so that it has loaded kernels and libraries.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from nsbench.measure import clock
from nsbench.measure.cost_growth import grow

SECONDS = 60.0  # of the runs of one method, where nothing else is asked for
SPAN = 4.0
# of the seconds in the fineness: noise of quick runs hides the cost of their steps
LEAST_POWER = 0.5
SHORTEST = 1e-9  # seconds, in logarithms


@dataclass
class SearchBudget:
    """Seconds for the tries of one method whose accuracy parameter is `accuracy`."""

    accuracy: str
    seconds: float = SECONDS
    spent: float = 0.0
    tries: dict[float, float] = field(default_factory=dict)  # seconds of a try, by its accuracy
    runs: dict[float, float] = field(default_factory=dict)  # of its one run alone

    def time_try(self, value: float, call: Callable[[], Any]) -> Any:
        """Call, count the seconds as those of the try of `value`; return what the call returns."""
        out, seconds = _timed(call)
        self.tries[value] = seconds
        self.spent += seconds
        return out

    def time_run(self, value: float, call: Callable[[], Any]) -> Any:
        """Call, keep the seconds as those of one run with `value`; return what the call returns.

        A run of which rounds are made (see clock.rounds_of) is made twice, and its second call
        counts.
        """
        out, seconds = _timed(call)
        if clock.rounds_of(seconds) > 1:
            out, seconds = _timed(call)
        self.runs[value] = seconds
        return out

    def allows(self, value: float) -> bool:
        """Is a try of `value` expected to end within the budget?"""
        if not self.tries:
            return True
        last = next(reversed(self.tries))
        ahead = self._growth(last, value)
        return self.spent + self.tries[last] * ahead <= self.seconds

    def has_left(self) -> bool:
        """Is there as much left as was spent?"""
        return 2.0 * self.spent <= self.seconds

    def expected_run(self, value: float) -> float:
        """Return the expected seconds of one run with `value`; NaN where none was timed."""
        if not self.runs:
            return math.nan
        finest = max(self.runs, key=self._fineness)
        return self.runs[finest] * self._growth(finest, value)

    def _fineness(self, value: float) -> float:
        return value if self.accuracy == "k" else 1.0 / value

    def _growth(self, known: float, value: float) -> float:
        """Return the factor between the seconds with two accuracies."""
        at = self._fineness(known)
        to = self._fineness(value)
        timed = {self._fineness(v): seconds for v, seconds in self.runs.items()}
        if not timed or max(timed) < SPAN * min(timed):
            timed = {at: 1.0}
        fineness = np.array(sorted(timed))
        seconds = np.array([max(timed[one], SHORTEST) for one in fineness])
        reached = [grow(self.accuracy, fineness, seconds, one) for one in (at, to)]
        ahead = reached[1] / reached[0]
        return max(ahead, (to / at) ** LEAST_POWER)


def _timed(call: Callable[[], Any]) -> tuple[Any, float]:
    out, seconds, compiling = clock.watched(call)
    return out, max(seconds - compiling, 0.0)
