"""Forecast of the time of runs, from rows of runs of the same kind.

Seconds are carried from rows of the journal to other accuracies: by an equal part for each step, or
by a power of tolerance or stiffness. Where a case and a solver have no rows, a few small runs are
made within a limit of time (nsbench.execute.probe); where these are missing too, the solver's
seconds of a run, and per step and coordinate, on other cases are taken; where it has none, those of
all solvers.
"""

from __future__ import annotations

import sys
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from nsbench.case import parse_spec
from nsbench.measure import clock
from nsbench.measure.cost_growth import STEEPEST_POWER, TYPICAL_POWER, grow, median_slope
from nsbench.study import Spec
from nsbench.study.plan import resolve

# what a forecast is made from
JOURNAL = "journal"
PROBE = "probe"
GUESS = "guess"
NOTHING = "refused"
# seconds: of a method where nothing is on the disk (six took 138 to 394 s)
COLD_COMPILATION = 45.0
SECONDS_PER_WORK = 1e-7  # of one step of one coordinate, where nothing at all is known
MEASURE = 0.1  # seconds of measuring a run and of its error bars, where no probe has shown them
# seconds of compiling: a probe with more of it does not show what measuring takes
COMPILED = 0.05
# in steps of one coordinate (0.1 us): measuring, a run by events, a step in Python
WORK_OF_RUN = 1e4
WORK_OF_EVENTS = 1e4
WORK_OF_PYTHON_STEP = 1e3
# neighbours from which a power is fitted, so that a floor of the seconds far away does not flatten
# it
FITTED_NEIGHBOURS = 6
RATES = (WORK_OF_RUN * SECONDS_PER_WORK, SECONDS_PER_WORK)  # where nothing at all is known
SHORTEST = 1e-9  # seconds, in logarithms


@dataclass(frozen=True)
class Cost:
    """Seconds in all of a run with its preparation and measuring, and what they are known from."""

    seconds: float
    source: str
    timing: float = 0.0  # of them: the rounds in which it is timed, when no worker runs anything


class _Timing(NamedTuple):
    """Clock columns of one row."""

    asked: float
    seconds: float
    setup: float
    compilation: float


class Forecast:
    """Seconds of runs to come.

    rows: of any runs with their seconds, old ones too; probed: rows of small runs, with `wall`, the
    seconds in all, beside the columns.
    """

    def __init__(self, rows: Iterable[dict], probed: Iterable[dict] = ()):
        self.known: dict[tuple[str, str], dict[str, list[_Timing]]] = defaultdict(
            lambda: defaultdict(list)
        )
        # by solver, of each case: seconds of a run without steps, and seconds per work of its steps
        self.rates: dict[str, list[tuple[float, float]]] = defaultdict(list)
        self.measuring: list[float] = []  # seconds of probes beside preparation and run
        for source, several in ((JOURNAL, rows), (PROBE, probed)):
            for row in several:
                self._learn(source, row)

    def _learn(self, source: str, row: dict) -> None:
        seconds = row.get("seconds", np.nan)
        if not (isinstance(seconds, float) and np.isfinite(seconds) and np.isfinite(row["asked"])):
            return
        timing = _Timing(
            row["asked"],
            seconds,
            row.get("setup_seconds", 0.0),
            row.get("compile_seconds", 0.0),
        )
        if source == PROBE and timing.compilation < COMPILED:
            rest = row["wall"] - seconds - _preparation(timing.setup) - timing.compilation
            self.measuring.append(max(0.0, rest))
        self.known[row["case"], row["solver"]][source].append(timing)

    def _timings(self, spec: Spec) -> tuple[str, list[_Timing]]:
        """Rows of the case with the solver and their source; GUESS and none if there are none."""
        known = self.known.get((spec.case, spec.solver))
        if not known:
            return GUESS, []
        source = JOURNAL if JOURNAL in known else PROBE
        return source, known[source]

    def cost(self, spec: Spec) -> Cost:
        """Forecast one run with all its repetitions. A refusal costs nothing."""
        if not np.isfinite(spec.asked):
            return Cost(0.0, NOTHING)
        source, timings = self._timings(spec)
        setup = float(np.median([t.setup for t in timings])) if timings else 0.0
        measuring = float(np.median(self.measuring)) if self.measuring else MEASURE
        seconds = self.seconds(spec)
        whole = seconds_with_repetitions(seconds, setup) + measuring
        return Cost(whole, source, timing_seconds(seconds))

    def seconds(self, spec: Spec) -> float:
        """Forecast the run alone, once."""
        _, timings = self._timings(spec)
        if not timings:
            return self._guess(spec)
        asked = np.array([t.asked for t in timings])
        seconds = np.array([t.seconds for t in timings])
        same = np.isclose(asked, spec.asked, rtol=1e-9, atol=0.0)
        if same.any():
            return float(np.median(seconds[same]))
        return extrapolate_seconds(asked, seconds, spec.asked, spec.accuracy)

    def compilation(self, solvers: Iterable[str]) -> float:
        """Forecast the seconds of compiling and loading: for each solver the longest so far, and
        COLD_COMPILATION for each method without a row whose kernels are not on the disk.

        The cases of a solver share its kernels.
        """
        longest: dict[str, float] = defaultdict(float)
        for (_, solver), known in self.known.items():
            for timings in known.values():
                longest[solver] = max([longest[solver], *(t.compilation for t in timings)])
        wanted = {*solvers}
        unknown = {parse_spec(s)[0] for s in wanted - {*longest}}
        cold = sum(not _is_stored(method) for method in unknown)
        return sum(longest[s] for s in wanted & {*longest}) + COLD_COMPILATION * cold

    def _guess(self, spec: Spec) -> float:
        """Seconds by the work of the run, at the median rates of the solver or of all solvers."""
        if not self.rates:
            self._fill_rates()
        rates = self.rates.get(spec.solver) or self.rates.get("") or [RATES]
        fixed, each = np.median(rates, axis=0)
        return float(fixed + each * work_of_steps(spec))

    def _fill_rates(self) -> None:
        """Fit seconds = fixed + each work to the rows of every case and solver."""
        for (case, solver), known in self.known.items():
            accuracy = _accuracy_of(solver)
            for timings in known.values():
                try:
                    done = [
                        work_of_steps(Spec(case, solver, accuracy, t.asked)) for t in timings
                    ]
                except (LookupError, ValueError):  # a case of a file, or of another version
                    continue
                rates = _fit_rates(np.array(done), np.array([t.seconds for t in timings]))
                self.rates[solver].append(rates)
                self.rates[""].append(rates)


def _fit_rates(done: np.ndarray, seconds: np.ndarray) -> tuple[float, float]:
    """Fit seconds (m,) = fixed + each done (m,); neither is negative."""
    least = int(np.argmin(done))
    if np.ptp(done) == 0.0:
        return 0.0, float(np.median(seconds)) / max(float(done[least]), 1.0)
    each = max(0.0, float(np.polyfit(done, seconds, 1)[0]))
    return max(0.0, float(seconds[least] - each * done[least])), each


def _preparation(setup: float) -> float:
    """Seconds of preparing a run: a slow preparation is made twice, to see what compiling took."""
    return 2.0 * setup if setup > clock.AGAIN else setup


def seconds_with_repetitions(seconds: float, setup: float) -> float:
    """Seconds of preparing a run, running it once, and the rounds in which it is timed."""
    return _preparation(setup) + seconds + timing_seconds(seconds)


def timing_seconds(seconds: float) -> float:
    """Seconds of the rounds in which a run is timed after the first one; 0 where that counts."""
    rounds = clock.rounds_of(seconds)
    return rounds * seconds if rounds > 1 else 0.0


def extrapolate_seconds(
    asked: np.ndarray, seconds: np.ndarray, at: float, accuracy: str
) -> float:
    """Seconds at another accuracy.

    Between known accuracies log(seconds) is interpolated linearly in log(accuracy). Beyond them the
    nearest FITTED_NEIGHBOURS are carried on: to finer runs by cost_growth.grow, to coarser ones by
    a power, which is not negative.

    asked, seconds: (m,), in any order; at: the accuracy wanted; accuracy: "h", "tol" or "k".
    """
    fineness = asked if accuracy == "k" else 1.0 / asked
    to = at if accuracy == "k" else 1.0 / at
    order = np.argsort(fineness)
    fineness = fineness[order]
    seconds = np.maximum(seconds[order], SHORTEST)
    if to > fineness[-1]:
        nearest = slice(-FITTED_NEIGHBOURS, None)
        return grow(accuracy, fineness[nearest], seconds[nearest], to)
    x = np.log(fineness)
    y = np.log(seconds)
    target = np.log(to)
    if to >= fineness[0]:
        return float(np.exp(np.interp(target, x, y)))
    power = median_slope(x[:FITTED_NEIGHBOURS], y[:FITTED_NEIGHBOURS])
    power = TYPICAL_POWER[accuracy] if np.isnan(power) else min(max(power, 0.0), STEEPEST_POWER)
    return float(np.exp(y[0] + power * (target - x[0])))


def work(spec: Spec) -> float:
    """Guess the work of a run, in steps of one coordinate; 0 for a refusal."""
    return 0.0 if np.isnan(spec.asked) else WORK_OF_RUN + work_of_steps(spec)


def work_of_steps(spec: Spec) -> float:
    """Guess the work of the steps of a run: they are known for "h", guessed for "k" and "tol"."""
    case = resolve(spec.case, spec.file, spec.references)
    span = float(case.t[-1] - case.t[0])
    steps = {"h": span / spec.asked, "k": span * spec.asked / 3}.get(spec.accuracy, WORK_OF_EVENTS)
    in_python = WORK_OF_PYTHON_STEP if "backend=" in spec.solver else 0
    return steps * (case.n + in_python)


def _is_stored(method: str) -> bool:
    """Is something that numba compiles for a method on the disk?"""
    from nsbench import solvers
    from nsbench.source_files.kernel_files import has_stored_kernels

    source = sys.modules[type(solvers.get(method)).__module__].__file__
    return has_stored_kernels(Path(source).parent)


def _accuracy_of(solver: str) -> str:
    from nsbench import solvers

    return solvers.get(solver).accuracy


def select_probes(specs: Iterable[Spec]) -> list[Spec]:
    """Select the small runs to make among those of which nothing is known.

    Of every case and solver the coarsest accuracy and one a third down the ladder; first one pair
    of each solver, and those of little work before the others.
    """
    ladders: dict[tuple, list[Spec]] = {}
    for s in specs:
        if np.isfinite(s.asked):
            ladders.setdefault((s.case, s.file, s.solver), []).append(s)
    pairs = []
    for ladder in ladders.values():
        coarsest_first = sorted(ladder, key=lambda s: s.asked, reverse=ladder[0].accuracy != "k")
        pair = (coarsest_first[0], coarsest_first[len(ladder) // 3])
        pairs.append(list(dict.fromkeys(pair)))
    pairs.sort(key=lambda pair: work(pair[0]))
    least_of_solver = {pair[0].solver: pair for pair in reversed(pairs)}
    first = list(least_of_solver.values())
    rest = [pair for pair in pairs if not any(pair is f for f in first)]
    return [s for pair in (*first, *rest) for s in pair]
