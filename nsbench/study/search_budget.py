"""Seconds that the runs of one search may take: what was spent, and what a further try would take.

Seconds are a power of the accuracy, fitted to single runs where their accuracies span a factor
SPAN, otherwise that of TYPICAL_POWER. What is paid once counts for nothing: compilation is taken
off, and a quick run is made again, so that it has loaded kernels and libraries.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from nsbench.measure import clock

SECONDS = 60.0  # of the runs of one method, where nothing else is asked for
SPAN = 4.0
STEEPEST = 2.0
LEAST_POWER = 0.5  # what runs of any accuracy have in common hides the cost of their steps
# of the seconds in 1 / h and in k: an implicit method takes longer steps where the system is stiff
TYPICAL_POWER = {"h": 1.0, "k": 0.5}


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
        """Return the logarithm of 1 / h or of k."""
        return math.log(value) if self.accuracy == "k" else -math.log(value)

    def _growth(self, known: float, value: float) -> float:
        """Return the factor between the seconds with two accuracies, a power of theirs."""
        power = TYPICAL_POWER.get(self.accuracy, 1.0)
        x = np.array(sorted(self._fineness(v) for v in self.runs))
        if x.size > 1 and np.ptp(x) >= math.log(SPAN):
            by = {self._fineness(v): max(s, 1e-9) for v, s in self.runs.items()}
            y = np.log([by[at] for at in x])
            # a floor of the seconds of the quickest runs flattens the fit, never the cost of steps
            last = (y[-1] - y[-2]) / (x[-1] - x[-2])
            power = float(np.clip(max(np.polyfit(x, y, 1)[0], last), LEAST_POWER, STEEPEST))
        return math.exp(power * (self._fineness(value) - self._fineness(known)))


def _timed(call: Callable[[], Any]) -> tuple[Any, float]:
    out, seconds, compiling = clock.watched(call)
    return out, max(seconds - compiling, 0.0)
