"""Seconds that the runs of one search may take: what was spent, and what a further try would take.

Seconds of a try are a power of its accuracy. The power is fitted where the tries so far span a
factor SPAN; otherwise it is that of TYPICAL_POWER. Compilation counts for nothing: it is paid once.
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
        """Call, keep the seconds as those of one run with `value`; return what the call returns."""
        out, self.runs[value] = _timed(call)
        return out

    def allows(self, value: float) -> bool:
        """Is a try of `value` expected to end within the budget?"""
        return not self.tries or self.spent + self._expected(self.tries, value) <= self.seconds

    def has_left(self) -> bool:
        """Is there as much left as was spent?"""
        return 2.0 * self.spent <= self.seconds

    def expected_run(self, value: float) -> float:
        """Return the expected seconds of one run with `value`; NaN where none was timed."""
        return self._expected(self.runs, value) if self.runs else math.nan

    def _expected(self, timed: dict[float, float], value: float) -> float:
        """Extrapolate seconds from those of the most accurate try by a power of the accuracy."""
        sign = 1.0 if self.accuracy == "k" else -1.0
        known = np.array(sorted(timed, key=lambda v: sign * v))
        seconds = np.array([max(timed[v], 1e-9) for v in known])
        x = sign * np.log(known)
        power = TYPICAL_POWER.get(self.accuracy, 1.0)
        if np.ptp(x) >= math.log(SPAN):
            power = float(np.clip(np.polyfit(x, np.log(seconds), 1)[0], 0.0, STEEPEST))
            # a floor of the seconds of the quickest runs flattens the fit, never the cost of steps
            power = max(power, float(np.log(seconds[-1] / seconds[-2]) / np.ptp(x[-2:])))
        ahead = sign * math.log(value) - float(x[-1])
        return float(seconds[-1] * math.exp(min(power, STEEPEST) * ahead))


def _timed(call: Callable[[], Any]) -> tuple[Any, float]:
    out, seconds, compiling = clock.watched(call)
    return out, max(seconds - compiling, 0.0)
