"""Choose the accuracy of a method for an error that is asked for, without a reference.

Methods with error bars (nsbench.error_bars) are run with long steps, then with the steps at which
their bar would be the error asked for. Of any other method two runs with shorter steps are compared
with it: the difference over 1 - (their step) / (the step) estimates its error, exactly for order
one, from above for a higher order; the larger one counts. Their numbers of steps are no multiples
of its own: where a method chatters about a surface, a step and half of it can both end on that
surface by chance. Methods that control their error by a tolerance are run at their default one, and
what they claim is taken. A search ends where the next try would pass its budget of seconds or
MOST_STEPS, and says which accuracy its last error and the order of the method ask for.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from nsbench import solvers
from nsbench.case import Case
from nsbench.dynamics.contacts.tolerances import scene_of
from nsbench.dynamics.scaling.estimate import case_scale, particle_diameter
from nsbench.error_bars import ErrorBars, without_error_bars
from nsbench.problem import Complementarity
from nsbench.solvers.base import Solver, accuracy_unit
from nsbench.solvers.scaled_run import ScaledRun
from nsbench.study import search_budget
from nsbench.study.search_budget import SearchBudget
from nsbench.trajectory import Trajectory

SAFETY = 0.8  # of the error asked for, which the next run is to have
LEAST = 1.0 / 32.0  # an accuracy changes by no more at once: what is known of it is not local
RUNS = 14
DIGITS = 3  # of a step, at least
MOST_DIGITS = 10
ROUNDING = 1e-9  # of a number of steps between samples
SHORTER = (0.72, 0.55)  # of a step: those of the runs with which its run is compared
FIRST_STEPS = 32  # of the first run, at least
MOST_STEPS = 5_000_000
PROVEN = "proven bound"
ESTIMATED = "estimate"
SEEN = "its violations are seen, its error is not known"
COMPARED = "estimate from shorter steps"
CLAIMED = "claimed by the method"


@dataclass(frozen=True)
class Choice:
    """What is needed of one method for an error.

    name, accuracy: of its accuracy parameter ("h", "tol", "k"), and the value that is enough; NaN
    if none was found. seconds: of one prepared run with it. error: bar, estimate or claim of the
    state's error there, reaction and impulse: of the multipliers (NaN where nothing is known).
    violation: largest violation of a constraint that was seen. sure: how the error is known. why: a
    sentence where no accuracy was found, or where the estimate is not to be trusted. needs,
    needs_seconds: where none was found, the accuracy that would do and the seconds of one run with
    it, both extrapolated (NaN where no run tells them).
    """

    method: str
    name: str
    accuracy: float = math.nan
    seconds: float = math.nan
    error: float = math.nan
    violation: float = math.nan
    reaction: float = math.nan
    impulse: float = math.nan
    sure: str = ""
    why: str = ""
    needs: float = math.nan
    needs_seconds: float = math.nan

    @property
    def is_found(self) -> bool:
        """Was an accuracy found?"""
        return self.accuracy == self.accuracy


@dataclass(frozen=True)
class Demand:
    """What is asked for: largest error of the state in the 2-norm, and largest violation (inf:
    any)."""

    error: float
    overlap: float = math.inf


def demand_of(case: Case, error: str | None, overlap: str | None = None) -> Demand:
    """Return the demand of two texts, each a length in the units of the case or a per cent; None:
    any.

    Per cents of the error are of the largest size of a coordinate (`Case.scale`, else estimated),
    those of the overlap of the smallest diameter of hard particles, or of that size where there
    are none.
    ValueError for a text that is neither, for an overlap of a case without constraints, and where
    nothing is asked for.
    """
    if error is None and overlap is None:
        raise ValueError("--error, --overlap or both are needed")
    if overlap is not None and not isinstance(case.problem, Complementarity):
        raise ValueError(f"--overlap is {overlap!r}; {case.key} has no constraints to violate")
    size = float(np.max(case_scale(case).state))
    wide = particle_diameter(case)
    return Demand(
        math.inf if error is None else _length("error", error, size),
        math.inf if overlap is None else _length("overlap", overlap, wide or size),
    )


def _length(name: str, text: str, size: float) -> float:
    number = text.strip().removesuffix("%")
    try:
        value = float(number) * (size / 100.0 if text.strip().endswith("%") else 1.0)
    except ValueError:
        raise ValueError(f"--{name} is {text!r}; a number such as 1e-2 or 1% is needed") from None
    return solvers.check_positive(f"--{name}", value)


def choose(
    case: Case,
    spec: str,
    demand: Demand,
    announce: Callable[[str], None] = lambda text: None,
    budget: float = search_budget.SECONDS,
) -> Choice:
    """Choose the accuracy of the method `spec` for a case; what failed is told by `why`.

    announce: called before each run with the accuracy that is tried, which can take minutes.
    budget: seconds that the runs of the search may take; a method with a tolerance is run once.
    """
    method = solvers.get(spec)
    refusal = method.refuses(case)
    if refusal:
        return Choice(spec, method.accuracy, why=refusal)
    if method.accuracy == "tol":
        return _by_claim(case, spec, method, demand)
    return _Search(case, spec, method, demand, budget).choice(announce)


def _by_claim(case, spec, method, demand) -> Choice:
    """Take what a method with a tolerance claims, or the error bars that it keeps below it."""
    has_bars = getattr(method, "tol", None) is not None
    asked = min(method.default, demand.error) if has_bars else method.default
    run = ScaledRun(method, case, asked)
    timed = SearchBudget(method.accuracy)
    traj = run.check_and_convert(timed.time_run(asked, run))
    if not traj.status.ok:
        return Choice(spec, "tol", why=str(traj.status))
    size = max(1.0, float(np.max(case_scale(case).state)))
    error = (method.claims.exact or math.nan) * size
    sure = CLAIMED
    reaction = impulse = math.nan
    if has_bars:
        bars = traj.bound
        error, reaction, impulse = (
            float(np.max(a)) for a in (bars.state, bars.reaction, bars.impulse)
        )
        sure = PROVEN if bars.is_proven else ESTIMATED
    violation = _violation(case, traj)
    if demand.error < math.inf and not error <= demand.error:
        why = f"its claim of {error:.2g} is not enough" if error == error else "it claims no error"
        return Choice(spec, "tol", why=f"Asked for {demand.error:.2g}, {why}.")
    if violation > demand.overlap:
        return Choice(spec, "tol", why=f"It violates a constraint by {violation:.2g}.")
    seconds = _seconds(run, timed.runs[asked])
    return Choice(spec, "tol", asked, seconds, error, violation, reaction, impulse, sure)


class _Search:
    """Runs of one method with ever better accuracies until the demand is met."""

    def __init__(
        self,
        case: Case,
        spec: str,
        method: Solver,
        demand: Demand,
        budget: float = search_budget.SECONDS,
    ):
        self.case = case
        self.spec = spec
        self.method = method
        self.demand = demand
        self.by_stiffness = method.accuracy == "k"
        self.budget = SearchBudget(method.accuracy, budget)
        self.needed = math.nan  # the accuracy that the errors so far ask for
        self.order = method.claims.state or 1.0
        span = float(case.t[-1] - case.t[0])
        self.spacing = float(np.diff(case.t).min())
        step = min(self.spacing, span / FIRST_STEPS)
        stiffness = float(getattr(method, "ladder", (method.default,))[0])
        stiffness *= accuracy_unit(method, case)
        self.first = stiffness if self.by_stiffness else step

    def choice(self, announce: Callable[[str], None]) -> Choice:
        """Search, and describe the first accuracy that is enough."""
        value = self._printed(self.first)
        last = ""
        within = ""
        for _ in range(RUNS):
            if not self._is_within_budget(value):
                within = f" within {self.budget.seconds:g} s (--budget)"
                break
            known = f" ({last})" if last else ""
            announce(f"{self.spec}: trying {self.method.accuracy} = {value:.3g}{known}")
            run, found, ratio = self.budget.time_try(value, partial(self._tried, value))
            if found.is_found and ratio <= 1.0:
                return replace(found, seconds=_seconds(run, self.budget.runs[value]))
            last = found.why or f"with {self.method.accuracy} = {value:.3g} it is {found.error:.2g}"
            if not found.is_found and not np.isfinite(ratio):
                ratio = SAFETY / 0.5  # a run that failed says nothing of how much is missing
                self.needed = math.nan
            else:
                self.needed = self._changed(value, min((SAFETY / ratio) ** (1 / self.order), 0.75))
            change = min(max((SAFETY / ratio) ** (1.0 / self.order), LEAST), 0.75)
            value = self._changed(value, change)
            if self._is_too_long(value):
                within = f" with {MOST_STEPS:.0e} steps, the most of a search".replace("e+0", "e")
                break
        return Choice(
            self.spec,
            self.method.accuracy,
            why=f"Not reached{within}: {last.rstrip('.')}.",
            needs=self.needed,
            needs_seconds=self.budget.expected_run(self.needed),
        )

    def _is_within_budget(self, value: float) -> bool:
        """May `value` be tried? The last try can have loaded kernels and libraries, or waited for
        another process that compiles: before it forbids a further one, it is timed again.
        """
        if not self.budget.allows(value) and self.budget.has_left():
            last = next(reversed(self.budget.tries))
            self.budget.time_try(last, partial(self._tried, last))
        return self.budget.allows(value)

    def _changed(self, value: float, change: float) -> float:
        """Return the accuracy of a step, or of 1 / k, that is `change` times as long."""
        return self._printed(value / change if self.by_stiffness else value * change)

    def _printed(self, value: float) -> float:
        """Round to the digits that are printed, or to more of a step where fewer would give another
        number of steps between samples: what is printed is what was run."""
        if self.by_stiffness:
            return _rounded_up(value, DIGITS)
        steps = self._steps(value)
        step = self.spacing / steps
        tried = (_rounded_up(step, digits) for digits in range(DIGITS, MOST_DIGITS))
        longest = self.spacing * (1.0 + ROUNDING)  # longer ones do not end at the samples
        enough = (v for v in tried if self._steps(v) == steps and step <= v <= longest)
        return next(enough, step)

    def _steps(self, value: float) -> int:
        """Return the number of steps of about this length between two samples."""
        return math.ceil(self.spacing / value * (1.0 - ROUNDING))

    def _is_too_long(self, value: float) -> bool:
        span = float(self.case.t[-1] - self.case.t[0])
        return not self.by_stiffness and span / value > MOST_STEPS

    def _tried(self, value: float) -> tuple[ScaledRun, Choice, float]:
        """Run with this accuracy; return the run, what it is worth, and error over demand."""
        run = ScaledRun(self.method, self.case, value)
        traj = run.check_and_convert(self.budget.time_run(value, run))
        known = Choice(self.spec, self.method.accuracy, why=str(traj.status))
        if not traj.status.ok:
            return run, known, math.inf
        has_bars = traj.bound is not None and not without_error_bars(self.case)
        bars = traj.bound if has_bars else self._compared(value, traj)
        over = 0.0
        violation = _violation(self.case, traj)
        if self.demand.overlap < math.inf:
            over = violation / self.demand.overlap
        if bars is None or not np.isfinite(np.max(bars.state)):
            why = bars.why if bars is not None else "a run with a shorter step failed"
            blind = Choice(self.spec, self.method.accuracy, violation=violation, why=why)
            if self.demand.error == math.inf:  # what is asked for is seen in the run itself
                return run, replace(blind, accuracy=value, sure=SEEN), over
            return run, blind, math.inf
        sure = COMPARED if not has_bars else PROVEN if bars.is_proven else ESTIMATED
        error = float(np.max(bars.state))
        found = Choice(
            self.spec,
            self.method.accuracy,
            value,
            math.nan,
            error,
            violation,
            float(np.max(bars.reaction)),
            float(np.max(bars.impulse)),
            sure,
            bars.why,
        )
        return run, found, max(error / self.demand.error, over)

    def _finer(self, value: float) -> list[float]:
        """Return accuracies at which about SHORTER parts of the step are taken, or of 1 / k.

        The numbers of steps between samples have no divisor in common with that of the step, and
        are even where it is odd: a method that chatters with any period is back on the surface at
        the samples for some numbers of steps, and their multiples.
        """
        if self.by_stiffness:
            return [value / part for part in SHORTER]
        steps = self._steps(value)
        counts: list[int] = []
        for part in SHORTER:
            more = max(math.ceil(steps / part), steps + 1)
            while more % 2 == steps % 2 or math.gcd(more, steps) > 1 or more in counts:
                more += 1
            counts.append(more)
        return [self.spacing / more for more in counts]

    def _compared(self, value: float, traj: Trajectory) -> ErrorBars | None:
        """Return error bars of `traj` from runs with shorter steps; None if one failed."""
        from nsbench.error_bars import Bars

        bars = np.full((3, len(traj.t)), np.nan)  # of state, reaction, impulse
        for finer in self._finer(value):
            run = ScaledRun(self.method, self.case, finer)
            other = run.check_and_convert(run())
            if not other.status.ok:
                return None
            taken = value / finer
            if not self.by_stiffness:
                taken = other.stats.get("h", finer) / traj.stats.get("h", value)
            pairs = (
                (traj.x, other.x, True),
                (traj.reaction, other.reaction, traj.reaction.size > 0),
                (traj.impulse, other.impulse, traj.contacts == other.contacts),
            )
            for k, (one, two, is_known) in enumerate(pairs):
                if is_known and one.shape == two.shape:
                    apart = np.linalg.norm(one - two, axis=1) / (1.0 - taken)
                    bars[k] = np.fmax(bars[k], apart)
        found = Bars(traj.t, *bars)
        return ErrorBars(lambda: found)


def _rounded_up(value: float, digits: int) -> float:
    """Round a positive number up to so many significant digits; one that has them stays."""
    unit = 10.0 ** (math.floor(math.log10(value)) - digits + 1)
    return float(f"{math.ceil(value / unit * (1.0 - ROUNDING)) * unit:.{digits - 1}e}")


def _seconds(run: ScaledRun, known: float) -> float:
    """Return the seconds of a prepared run that was called before: the median of its rounds.

    known: seconds of that call, without compilation; a run that is timed once is not made again.
    """
    from nsbench.measure import clock

    if clock.rounds_of(known) <= 1:
        return known
    _, first, _ = clock.first_call(run)
    rounds = clock.rounds_of(first)
    if rounds <= 1:
        return first
    (times,) = clock.in_rounds([run], [rounds], lambda i: None)
    return float(np.median(times)) if not isinstance(times, Exception) else first


def _violation(case: Case, traj: Trajectory) -> float:
    """Return the largest violation of a constraint at a recorded state; NaN without any."""
    if not isinstance(case.problem, Complementarity):
        return math.nan
    scene = scene_of(case)
    t = traj.t
    x = traj.x
    if traj.between is not None:
        t = np.concatenate([t, traj.between[0]])
        x = np.concatenate([x, traj.between[1]])
    return max(scene.max_violation(float(s), y) for s, y in zip(t, x, strict=True))


def cheapest(choices: list[Choice]) -> Choice | None:
    """Return the choice with the fewest seconds of those that were found; None without any."""
    found = [c for c in choices if c.is_found and c.seconds == c.seconds]
    return min(found, key=lambda c: c.seconds, default=None)
