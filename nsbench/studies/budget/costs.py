"""Cost of PBD and of catching-up: per step, and at equal error.

Both methods run with steps spacing / 2^k until their share of the seconds is spent; all runs are
then timed in interleaved rounds. Seconds at an error come from the curve of seconds over error: by
interpolation of logarithms, or, where a method did not get so far, from its finest run by order 1,
seconds ~ 1 / error, if its last halving of the step did halve the error (such values are marked).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nsbench.case import Case, get_case
from nsbench.measure import clock
from nsbench.reference import Reference
from nsbench.solvers import get
from nsbench.studies.plateau.scenes import find_scene
from nsbench.studies.runs.finished_run import USABLE
from nsbench.studies.runs.truth import extrapolate, find_truth

METHODS = ("pbd", "catching_up")
TARGETS = (1e-2, 1e-3, 1e-4, 1e-6)
LARGE = 300  # discs beyond which the run is SHORT
SHORT = np.linspace(0.0, 0.25, 4)
HUGE = 5000  # discs beyond which the run is VERY_SHORT
VERY_SHORT = np.linspace(0.0, 0.1, 3)
SAME_STEP = 16  # steps per sample at which the two are compared step by step
ROUNDS = 5
MAX_HALVINGS = 18
MIN_RUNS = 8
HALVED = (1.6, 2.5)  # ratio of two errors, or of seconds, that counts as two


@dataclass(frozen=True)
class Cost:
    """Seconds at an error; extrapolated: by order 1 from the finest run; NaN: not known."""

    seconds: float
    extrapolated: bool


def find_discs(n: int) -> Case:
    """Return n free discs, over a shorter time where they are many."""
    case = get_case("discs", n=n, seed=0)
    if n <= LARGE:
        return case
    return case.replace(t=VERY_SHORT if n > HUGE else SHORT)


def measure_scene(key: str, budget: float) -> dict:
    """Measure both methods on a scene; budget: seconds of runs of each method.

    key: a number of discs, or the key of a scene. Returns rows of all runs with errors, seconds
    and counted work, the ratio of one step, and what is known of the true solution. Raises
    ArithmeticError where the witness of the latter (_confirm) contradicts it.
    """
    case = find_discs(int(key)) if key.isdigit() else find_scene(key)
    truth = find_truth(case)
    found = [pair for m in METHODS for pair in _descend(case, m, truth, budget)]
    rounds = [clock.FEWEST if row["seconds"] < clock.LONG else 1 for row, _ in found]
    times = clock.in_rounds([run for _, run in found], rounds, lambda i: None)
    rows = [
        {**row, "seconds": float(np.median(seconds))}
        for (row, _), seconds in zip(found, times, strict=True)
        if not isinstance(seconds, Exception)
    ]
    return {
        "scene": key,
        "case": case.key,
        "span": float(case.t[-1] - case.t[0]),
        "rows": rows,
        "step_ratio": _compare_steps(case),
        "truth": truth.kind,
        "truth_error": truth.state_error,
        "witness": _confirm(case, truth) if key.isdigit() and int(key) > LARGE else None,
    }


def _confirm(case: Case, truth: Reference) -> dict:
    """Compare the truth of many discs with one that shares nothing with it but the case.

    That is catching-up extrapolated from three steps, which follows no events. Returns how it was
    made, its distance from the truth and its own bound; raises ArithmeticError where the distance
    is larger than both bounds together.
    """
    other = extrapolate(case)
    distance = float(np.abs(other.x - truth.x).max())
    if distance > truth.state_error + other.state_error:
        raise ArithmeticError(
            f"{case.key}: {truth.how} and {other.how} differ by {distance:g}, more than their "
            f"bounds {truth.state_error:g} and {other.state_error:g}"
        )
    return {"how": other.how, "distance": distance, "bound": other.state_error}


def _descend(case: Case, method: str, truth, budget: float) -> list[tuple[dict, object]]:
    """Halve the step until the seconds are spent or the smallest target is reached."""
    out = []
    spent = 0.0
    spacing = float(np.diff(case.t).min())
    for k in range(MAX_HALVINGS):
        run, _ = clock.prepared(lambda h=spacing / 2**k: get(method).prepare(case, h))
        traj, took, _ = clock.first_call(run)
        spent += took
        if traj.status.code in USABLE and np.isfinite(traj.x).all():
            row = {
                "method": method,
                "h": spacing / 2**k,
                "steps": int(traj.stats.get("steps", 0)),
                "inner": int(traj.stats.get("inner_iterations", 0)),
                "projections": int(traj.stats.get("projections", 0)),
                "error": float(np.abs(traj.x - truth.x).max()),
                "seconds": took,
            }
            out.append((row, run))
            if row["error"] < max(TARGETS[-1], 10.0 * truth.state_error):
                break
        # the next run takes up to twice as long; a curve of fewer than MIN_RUNS says nothing
        if spent + 2.2 * took > budget and k + 1 >= MIN_RUNS:
            break
    return out


def _compare_steps(case: Case) -> dict:
    """Time both methods with the same steps in interleaved rounds; ratio catching-up over PBD."""
    h = float(np.diff(case.t).min()) / SAME_STEP
    runs = {m: get(m).prepare(case, h) for m in METHODS}
    found = {m: run() for m, run in runs.items()}
    times = clock.interleaved(runs, ROUNDS)
    ratio = clock.ratio(times["catching_up"], times["pbd"])
    steps = max(1, int(found["pbd"].stats.get("steps", 1)))
    return {
        "median": ratio.median,
        "low": ratio.low,
        "high": ratio.high,
        "pbd_step_seconds": times["pbd"].median / steps,
        "inner_per_step": found["catching_up"].stats.get("inner_iterations", 0) / steps,
        "h": h,
    }


def cost_at(rows: list[dict], method: str, target: float, floor: float = 0.0) -> Cost:
    """Return the seconds of a method at an error; floor: an error below it may be as large."""
    nothing = Cost(float("nan"), False)
    own = [r for r in rows if r["method"] == method]
    if not own or target <= floor:
        return nothing
    # errors that grow again as the step shrinks are no progress: the envelope from the fine end
    errors = np.maximum.accumulate([max(r["error"], floor) for r in own][::-1])[::-1]
    seconds = np.array([r["seconds"] for r in own])
    below = int(np.argmax(errors <= target))
    if errors[0] <= target:
        return Cost(float(seconds[0]), False)
    if errors[below] <= target:
        share = np.log(errors[below - 1] / target) / np.log(errors[below - 1] / errors[below])
        slope = np.log(seconds[below] / seconds[below - 1])
        return Cost(float(seconds[below - 1] * np.exp(share * slope)), False)
    if len(own) < 2 or not _is_settled(errors[-2] / errors[-1], seconds[-1] / seconds[-2]):
        return nothing
    return Cost(float(seconds[-1] * errors[-1] / target), True)


def _is_settled(errors: float, seconds: float) -> bool:
    """Has the last halving of the step halved the error and doubled the seconds?"""
    low, high = HALVED
    return low < errors < high and low < seconds < high


def ratio_at(entry: dict, target: float) -> tuple[float, bool]:
    """Return seconds of catching-up over those of PBD at an error, and whether one is extrapolated.

    Above 1 PBD is the cheaper one; NaN where one of them is not known.
    """
    floor = 10.0 * entry["truth_error"]
    pbd, qp = (cost_at(entry["rows"], m, target, floor) for m in METHODS)
    return qp.seconds / pbd.seconds, pbd.extrapolated or qp.extrapolated


def error_ratio(entry: dict) -> float:
    """Return the error of PBD over that of catching-up at the finest step both were run with."""
    by_step: dict[float, dict[str, float]] = {}
    for row in entry["rows"]:
        by_step.setdefault(row["h"], {})[row["method"]] = row["error"]
    both = [h for h, e in by_step.items() if len(e) == len(METHODS) and e["catching_up"] > 0.0]
    if not both:
        return float("nan")
    finest = by_step[min(both)]
    return finest["pbd"] / finest["catching_up"]


def profile(entries: list[dict], target: float, factors: tuple[float, ...]) -> dict[str, list]:
    """Return the share of scenes that each method solves within factors of the cheaper one.

    The performance profile of Dolan & More (2002) over the scenes where at least one is known.
    """
    ratios: dict[str, list[float]] = {m: [] for m in METHODS}
    for entry in entries:
        floor = 10.0 * entry["truth_error"]
        costs = {m: cost_at(entry["rows"], m, target, floor).seconds for m in METHODS}
        known = [c for c in costs.values() if np.isfinite(c)]
        if not known:
            continue
        for m in METHODS:
            ratios[m].append(costs[m] / min(known) if np.isfinite(costs[m]) else np.inf)
    return {
        m: [float(np.mean(np.array(r) <= f)) if r else None for f in factors]
        for m, r in ratios.items()
    }
