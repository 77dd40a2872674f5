"""Compute the cost of a method at equal error, and decide which costs may be compared.

The cost of an error e is read off the work-precision curve: the error of each run is replaced by
the largest error over all smaller steps (its envelope), and seconds, counted work and step are
interpolated in their logarithms where the envelope falls below e. Ratios of seconds are formed only
between loops of one kind that were timed together (COMPARISON_RULE).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from nsbench.measure.clock import LONG
from nsbench.measure.cost_growth import grow
from nsbench.measure.orders.fit import ENDS
from nsbench.report.data import Data, Runs
from nsbench.report.style import (
    LEADING_METHOD,
    format_count,
    format_factor,
    format_number,
    format_power,
    format_seconds,
    join_names,
    method_of,
)
from nsbench.report.summary import Summary

TARGETS = (1e-2, 1e-3, 1e-4, 1e-6)  # state errors at which methods are compared
CERTAIN = "order"  # verdict of a fit: of all others the order is shown, but tells no step
MOST_WIDTH = 0.2  # of an order: a wider interval tells no step
LEAST_ORDER = 0.1  # errors that hardly fall with h, or not at all, tell no step either
LEAST_RELATIVE = 1e-12  # of the size of a quantity: errors below it are not extrapolated to
TALK_FACTOR = 100  # of stepping with an inner QP over PBD, as the talk has it
WORK_COLUMNS = ("drift_calls", "projections", "inner_iterations")


@dataclass(frozen=True)
class Cost:
    """The cost of one error with one method.

    at_most: the coarsest run was already better, so that all figures are upper bounds. seconds,
    low, high: of one run, with the quartiles over rounds. work: counted_work. h: the step (1/k or
    tolerance, see `accuracy`) that reaches the error. rounds: the fewest rounds that the seconds
    come from. session: the run of the bench in which they were measured, "" if that is not stored.
    is_extrapolated: no run reached the error; the lower end of the fitted order gets there.
    """

    solver: str
    loop: str
    seconds: float
    work: float
    h: float
    accuracy: str
    at_most: bool
    low: float = math.nan
    high: float = math.nan
    rounds: float = math.nan
    session: str = ""
    is_extrapolated: bool = False


def counted_work(runs: Runs) -> np.ndarray:
    """Count drift calls + projections + inner iterations of each run, (runs,).

    QP solves stand in where inner iterations are not counted; NaN where nothing is counted.
    """
    parts = {name: runs.col[name] for name in WORK_COLUMNS}
    inner = np.where(
        np.isfinite(parts["inner_iterations"]), parts["inner_iterations"], runs.col["qp_solves"]
    )
    stack = np.array([parts["drift_calls"], parts["projections"], inner])
    total = np.nansum(stack, axis=0)
    return np.where(np.isfinite(stack).any(axis=0) & (total > 0), total, np.nan)


def counted_inner_work(runs: Runs) -> np.ndarray:
    """Count the work inside the steps of each run: projections + inner iterations.

    Methods that report no inner iterations count by their QP solves instead. Errors are drawn
    against it beside the drift calls, which do not show it: a step with one drift call may take a
    sweep over all contacts, or ten iterations of Newton's method. Returns an array (runs,), NaN for
    a run that counts none of the three or zero in all: there is no place for 0 on a logarithmic
    axis.
    """
    parts = np.array(
        [
            runs.col["projections"],
            np.where(
                np.isfinite(runs.col["inner_iterations"]),
                runs.col["inner_iterations"],
                runs.col["qp_solves"],
            ),
        ]
    )
    total = np.nansum(parts, axis=0)
    return np.where(total > 0, total, np.nan)


COMPARISON_RULE = (
    "Seconds of two methods are compared only when both loops over steps are compiled, both were "
    f"timed on one machine in one go, and both in interleaved rounds (runs of more than {LONG:g} s "
    "once); then compilation and set-up are apart. Otherwise their counted work is compared, or "
    "nothing."
)


def why_not_comparable(one: Cost, other: Cost) -> str:
    """Explain why the seconds of two methods may not be compared; "" if they may.

    The conditions are those of COMPARISON_RULE.
    """
    if not (one.loop == "compiled" and other.loop == "compiled"):
        host = one if one.loop != "compiled" else other
        return (
            f"the loop of {host.solver} is not compiled ({host.loop or 'unmarked'}): its seconds "
            "measure an interpreter"
        )
    if one.session != other.session:
        return "their seconds were not measured in one go"
    for c in (one, other):
        if c.rounds < 2 and c.seconds < LONG:
            return f"{c.solver} was not timed in rounds"
        if not c.seconds > 0:
            return f"{c.solver} has no seconds of a machine of its own"
    return ""


def cost_at_error(runs: Runs, target: float, metric: str = "state_sup") -> Cost | None:
    """Compute the cost of an error of `target`; None if it is not reached.

    The error curve is replaced by its envelope, the largest error over all steps at most h, so that
    a single small error by chance does not count; between two runs, cost and step are interpolated
    in their logarithms. metric: the column of the error.
    """
    good = runs.good & np.isfinite(runs.col[metric]) & (runs.col["h"] > 0)
    if not good.any():
        return None
    h = runs.col["h"][good]
    error = np.abs(runs.col[metric][good])
    # envelope: runs go from the coarsest to the finest
    envelope = np.maximum.accumulate(error[::-1])[::-1]
    reached = np.flatnonzero(envelope <= target)
    if not reached.size:
        return None
    i = int(reached[0])
    share = 1.0
    if i and envelope[i] > 0:
        share = math.log(envelope[i - 1] / target) / math.log(envelope[i - 1] / envelope[i])
    interpolate = lambda v: _between(v[i - 1] if i else v[i], v[i], share)
    used = slice(max(i - 1, 0), i + 1)
    rounds = runs.col["rounds"][good][used]
    sessions = sorted({s for s in runs.col["session"][good][used] if s})
    return Cost(
        solver=runs.solver,
        loop=runs.loop,
        seconds=interpolate(runs.col["seconds"][good]),
        work=interpolate(counted_work(runs)[good]),
        h=interpolate(h),
        accuracy=runs.accuracy,
        at_most=i == 0,
        low=interpolate(runs.col["seconds_low"][good]),
        high=interpolate(runs.col["seconds_high"][good]),
        rounds=float(np.min(rounds)),
        session="+".join(sessions),
    )


def least_error(runs: Runs, metric: str = "state_sup") -> float:
    """Return the least error that cost_at_error takes for reached, that of the finest run; NaN
    where no error is known."""
    known = np.abs(runs.col[metric][runs.good & (runs.col["h"] > 0)])
    known = known[np.isfinite(known)]
    return float(known[-1]) if known.size else math.nan


def extrapolate_cost(summary: Summary, target: float) -> Cost | None:
    """Extrapolate the cost of an error that the ladder of steps does not reach, as expect_cost.

    None as well where the fit has no verdict: whatever names a step to a reader goes through here.
    """
    return expect_cost(summary, target) if summary.state.verdict == CERTAIN else None


def expect_cost(summary: Summary, target: float) -> Cost | None:
    """Expect the cost of an error by an order that may have no verdict, for runs that try it.

    With an order p of a narrow interval [a, b], and the finest step h, the step
    h (target / e)^(1/a) reaches it: at the lower end, since a step by p itself misses the error in
    every second case. e is the largest error of the fine end, carried to h by p, since errors may
    turn with the phase of the step. Seconds and work go on, as over the finer half of the runs, by
    an equal part for each step, or as a power of 1/k. None where a run reaches the error, no order
    is narrow, or the error is below the reference's floor or what rounding allows.
    """
    runs = summary.runs
    order = summary.state
    if order.kind != "fit" or order.verdict in ("plateau", "diverges"):
        return None
    low, high = order.interval
    is_narrow = order.order >= LEAST_ORDER and high - low <= MOST_WIDTH * order.order
    if not is_narrow or runs.accuracy == "tol" or cost_at_error(runs, target) is not None:
        return None
    if target <= max(runs.floor(order.metric), LEAST_RELATIVE * runs.scale(order.metric)):
        return None
    error = np.abs(runs.col[order.metric])
    good = np.flatnonzero(runs.good & (error > 0.0) & (runs.col["h"] > 0.0))
    h = runs.col["h"][good]
    end = h <= h[-1] * 2.0**ENDS
    level = float(np.max(error[good][end] * (h[-1] / h[end]) ** order.order))
    factor = (target / level) ** (1.0 / low)
    if not factor < 1.0:
        return None
    # an iterative method may need fewer iterations in fine steps
    finer = slice(len(h) // 2, None)
    to = 1.0 / (h[-1] * factor)
    grown = lambda values: grow(runs.accuracy, 1.0 / h[finer], values[finer], to)
    return Cost(
        solver=runs.solver,
        loop=runs.loop,
        seconds=grown(runs.col["seconds"][good]),
        work=grown(counted_work(runs)[good]),
        h=float(h[-1] * factor),
        accuracy=runs.accuracy,
        at_most=False,
        is_extrapolated=True,
    )


def format_extrapolated(cost: Cost) -> str:
    """Say which step an error needs: ``needs h = 6e-5, about 55 ms (extrapolated)``."""
    words = "host loop, extrapolated" if cost.loop == "host" else "extrapolated"
    return f"needs {format_setting(cost)}, about {format_seconds(cost.seconds)} ({words})"


def _between(a: float, b: float, share: float) -> float:
    """Interpolate between a and b in their logarithms; share 0 gives a, 1 gives b."""
    # NaN: seconds of a shared worker; those of the neighbouring run alone are no measurement
    if math.isnan(a):
        return a
    if not (a > 0 and b > 0):
        return float(b)
    return float(math.exp((1 - share) * math.log(a) + share * math.log(b)))


def rank_costs(data: Data, case: str, target: float) -> list[Cost]:
    """List the costs of all methods that reach `target` on `case`.

    Compiled loops come first, then the cheapest in seconds, then in counted work.
    """
    found = [c for c in (cost_at_error(r, target) for r in data.of_case(case)) if c is not None]
    unknown = math.inf
    return sorted(
        found,
        key=lambda c: (
            c.loop != "compiled",
            c.seconds if c.seconds > 0 else unknown,
            c.work if c.work > 0 else unknown,
            c.solver,
        ),
    )


def select_baseline(found: list[Cost]) -> Cost | None:
    """Return the PBD that factors refer to: the plain one if it is there, else the cheapest one."""
    own = [c for c in found if method_of(c.solver) == LEADING_METHOD]
    return next((c for c in own if c.solver == LEADING_METHOD), own[0] if own else None)


def format_setting(c: Cost) -> str:
    """Format the accuracy parameter: ``h = 0.01``, ``k = 100`` or ``tol = 1e-9``."""
    return (
        f"k = {format_number(1 / c.h)}"
        if c.accuracy == "k"
        else f"{c.accuracy} = {format_number(c.h)}"
    )


def ratio_of_seconds(one: Cost, other: Cost) -> float | None:
    """Divide the seconds of `one` by those of `other`; None unless both are known and comparable.

    A method whose coarsest run was already better has no cost at this error, only a bound.
    """
    return None if one.at_most else most_ratio_of_seconds(one, other)


def most_ratio_of_seconds(one: Cost, other: Cost) -> float | None:
    """Bound the ratio of seconds from above: those of `one` may be bounds, those of `other` not."""
    known = one.seconds > 0 and other.seconds > 0 and not other.at_most
    return one.seconds / other.seconds if known and not why_not_comparable(one, other) else None


def ratio_of_work(one: Cost, other: Cost) -> float | None:
    """Divide the counted work of `one` by that of `other`; None unless both are known."""
    known = one.work > 0 and other.work > 0 and not (one.at_most or other.at_most)
    return one.work / other.work if known else None


def step_for_violation(runs: Runs, target: float) -> Cost | None:
    """Compute the largest step with max(-g) <= `target`, and its cost; None if there is none."""
    return cost_at_error(runs, target, "feasibility")


def find_qp_methods(data: Data) -> set[str]:
    """List the methods that solve a QP in each step ("time-stepping with inner QP solver")."""
    return {s for (_, s), r in data.runs.items() if np.any(r.col["qp_solves"] > 0)}


def compare_speeds(data: Data) -> Iterator[str]:
    """Report factors over PBD at equal error, and whether the talk's factor of 100 was reached.

    Yields one sentence per method, one on the methods that cannot be compared, and one on the talk.
    """
    qp_methods = find_qp_methods(data)
    ratios = {}
    bounds = {}  # by method and error
    not_comparable = set()
    for case in data.case_keys:
        for target in TARGETS:
            found = rank_costs(data, case, target)
            base = select_baseline(found)
            for c in found:
                if base is None or c.solver == base.solver:
                    continue
                r = most_ratio_of_seconds(c, base)
                if r is None and c.loop != base.loop:
                    not_comparable.add(c.solver)
                elif r is not None and c.at_most and c.accuracy == "tol":
                    bounds.setdefault(c.solver, {}).setdefault(target, []).append(r)
                elif r is not None and not c.at_most:
                    ratios.setdefault(c.solver, []).append((r, case, target))
    for solver, group in ratios.items():
        values = [r for r, _, _ in group]
        yield (
            f"{solver} takes {format_factor(float(np.median(values)))} times the seconds of "
            f"{LEADING_METHOD} (median of {format_count(len(values), 'comparison')}; "
            f"{format_factor(min(values))} to {format_factor(max(values))})."
        )
    for solver in [name for name in bounds if name not in ratios]:
        yield _bounded_seconds(solver, bounds[solver])
    not_comparable -= {*ratios, *bounds}
    if not_comparable:
        yield (
            f"Seconds of {join_names(sorted(not_comparable))} are not compared with "
            f"{LEADING_METHOD}: their loops are of another kind."
        )
    gains = [g for solver in qp_methods for g in ratios.get(solver, [])]
    if gains:
        top, case, target = max(gains)
        seen = "was seen" if top >= TALK_FACTOR else "was not seen"
        yield (
            f"The talk's factor of 100 over stepping with an inner QP {seen} at equal error: at "
            f"most {format_factor(top)} times ({case} at {format_power(target)}), at least "
            f"{format_factor(min(gains)[0])}."
        )


def _bounded_seconds(solver: str, bounds: dict[float, list[float]]) -> str:
    """Compare, with PBD, the seconds of a method whose every run is better than the errors."""
    parts = [
        f"{format_factor(float(np.median(found)))} at {format_power(target)} "
        f"({format_count(len(found), 'case')})"
        for target, found in sorted(bounds.items(), reverse=True)
    ]
    return (
        f"{solver}, whose coarsest run is better than these errors already, takes at most so many "
        f"times the seconds of {LEADING_METHOD}, in the median: {', '.join(parts)}."
    )
