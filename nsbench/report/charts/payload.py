"""Data of the interactive page: runs, costs at equal error and orders, as one compressed JSON.

Costs are computed here once, by nsbench.report.cost, for every error that the slider offers: the
page only selects, counts and averages. Numbers are rounded to DIGITS digits; what is not a number
is null.
"""

from __future__ import annotations

import base64
import gzip
import json
import math

import numpy as np

from nsbench.report.answers.best_method import best_of_page
from nsbench.report.charts.bar_texts import QUANTITIES, error_bars, measurable
from nsbench.report.charts.coincidence import REACH, coincident_methods
from nsbench.report.charts.layouts import (
    METRICS,
    curve_chart,
    error_bar_chart,
    error_chart,
    order_chart,
    profile_chart,
    scatter_chart,
)
from nsbench.report.content import Content
from nsbench.report.cost import (
    Cost,
    cost_at_error,
    counted_inner_work,
    extrapolate_cost,
    format_extrapolated,
    least_error,
)
from nsbench.report.data import GOOD, Runs
from nsbench.report.panel_choice import STEP_LABEL
from nsbench.report.style import format_power
from nsbench.report.summary import Order, Summary

DIGITS = 4
# errors of the slider: half decades from 1e-1 to 1e-10
TARGETS = tuple(10.0 ** (-k / 2) for k in range(2, 21))
DEFAULT_TARGET = 4  # position of 1e-3 among TARGETS
COSTS = {"seconds": "seconds", "rhs": "drift_calls"}
INNER = "projections_and_inner_iterations"  # counted_inner_work, which is no column
SAME_STEP = 1e-6  # relative difference below which two accuracies are the same
MAX_RUNS = 200  # of one method on one case; more are thinned evenly


def encode_payload(content: Content) -> str:
    """Encode the data of the page: JSON, compressed by gzip, as base64 text."""
    return _pack(payload(content))


def _pack(value: dict) -> str:
    text = json.dumps(value, separators=(",", ":"), allow_nan=False)
    return base64.b64encode(gzip.compress(text.encode(), 9, mtime=0)).decode()


def pack_player(player: dict | None, runs: list[Runs]) -> str:
    """Pack the frames of a player with the seconds that its runs took in the study; "" for None.

    budget: the two runs, one of each method, whose seconds are nearest to each other; null where
    they are not known. Their steps differ as far as the costs of a step do.
    """
    if player is None:
        return ""
    shown = [{**run, **_match(run, runs)} for run in player["runs"]]
    return _pack({**player, "runs": shown, "budget": _same_budget(shown)})


def _match(shown: dict, runs: list[Runs]) -> dict:
    """Step and seconds of the run of the study that a player shows, None where it has none."""
    own = next((r for r in runs if r.solver == shown["solver"]), None)
    if own is None or not np.isfinite(own.col["asked"]).any():
        return {"h": None, "seconds": None}
    distance = np.abs(own.col["asked"] / shown["asked"] - 1)
    at = int(np.nanargmin(distance))
    near = bool(distance[at] < SAME_STEP)
    h = _number(float(own.col["h"][at])) if near else None
    seconds = _number(float(own.col["seconds"][at])) if near else None
    return {"h": h, "seconds": seconds}


def _same_budget(shown: list[dict]) -> list[int] | None:
    """Numbers of the two runs, of different methods, with the nearest seconds; None without any."""
    timed = [k for k, run in enumerate(shown) if run["seconds"]]
    pairs = [
        (abs(math.log(shown[a]["seconds"] / shown[b]["seconds"])), a, b)
        for a in timed
        for b in timed
        if a < b and shown[a]["solver"] != shown[b]["solver"]
    ]
    if not pairs:
        return None
    _, one, other = min(pairs)
    return [one, other]


def payload(content: Content) -> dict:
    """Collect the data of the page.

    targets, labels: errors of the slider. methods, cases: what is shown of each, with the best
    method at each target (`_best`). pairs: one entry per method and case (see `_pair`). groups:
    methods whose marks coincide in some chart. columns: of the results, by metric and cost. reach:
    see coincidence. layouts: the charts without data. scenes: players by case.
    """
    data = content.data
    position = {solver: k for k, solver in enumerate(data.specs)}
    cases = data.case_keys
    methods = [(solver, content.looks[solver]) for solver in data.specs]
    pairs = [
        _pair(summary, cases.index(case), position[solver])
        for (case, solver), summary in content.summaries.items()
    ]
    return {
        "targets": [_number(t) for t in TARGETS],
        "labels": [_label(t) for t in TARGETS],
        "default": DEFAULT_TARGET,
        "methods": [
            {"name": name, "tone": look.tone, "shape": look.marker} for name, look in methods
        ],
        "cases": [
            {
                "name": case,
                "id": content.ids[case],
                "group": str(data.cases.get(case, {}).get("problem") or "other"),
                "length": _number(data.cases.get(case, {}).get("own_length")),
                "tags": [str(t) for t in data.cases.get(case, {}).get("tags") or ()],
                "best": [_best(content, case, t, position) for t in TARGETS],
            }
            for case in cases
        ],
        "pairs": pairs,
        "groups": group_coincident(pairs),
        "columns": {**METRICS, "h": "h", **COSTS, "inner": INNER},
        "reach": REACH,
        "layouts": {
            "error": error_chart(methods, "", ""),
            "profile": profile_chart(methods),
            "scatter": scatter_chart("", ""),
            "bars": error_bar_chart(methods, "error in the 2-norm", "error bar"),
            "order": order_chart(methods, "order of convergence", len(cases)),
            "curve": curve_chart(""),
        },
        "step": STEP_LABEL,
    }


def group_coincident(pairs: list[dict]) -> list[list[int]]:
    """Note in each pair, by metric and cost, the methods whose marks coincide with a run's.

    pairs: as `_pair` returns them; each gets the entry `together`: by "metric/cost" a list with the
    number of a group for each run, -1 for a run whose mark is alone, of charts that have a group.
    Returns the groups, lists of methods by number.
    """
    groups: dict[tuple, int] = {}
    of_case: dict[int, list[dict]] = {}
    for pair in pairs:
        pair["together"] = {}
        if pair["word"] != "refused":  # charts leave these out
            of_case.setdefault(pair["c"], []).append(pair)
    for own in of_case.values():
        for chart in ((y, x) for y in ("force", *METRICS) for x in ("h", *COSTS, "inner")):
            marks = [mark for pair in own for mark in _marks(pair, *chart)]
            for mark, methods in zip(marks, coincident_methods(marks), strict=True):
                if len(methods) > 1:
                    together = mark["pair"]["together"]
                    alone = [-1] * len(mark["pair"]["status"])
                    group = groups.setdefault(tuple(methods), len(groups))
                    together.setdefault("/".join(chart), alone)[mark["run"]] = group
    return [list(methods) for methods in groups]


def _marks(pair: dict, y: str, x: str) -> list[dict]:
    """The marks of a method in the chart of errors y over x, as the page draws them."""
    errors = pair[y]
    own = {"method": pair["m"], "pair": pair}
    mark = lambda k, kind: {**own, "kind": kind, "run": k, "y": errors[k]}
    if x == "h" and pair["accuracy"] == "tol":
        known = [k for k, e in enumerate(errors) if pair["good"][k] and e]
        return [mark(min(known, key=errors.__getitem__), "level")] if known else []
    out = []
    for k, at in enumerate(_steps(pair) if x == "h" else pair[x]):
        good = pair["good"][k]
        if at and at > 0.0 and good and errors[k] is not None:
            out.append({**mark(k, "error" if errors[k] > 0.0 else "zero"), "x": at})
        elif at and at > 0.0 and not good and pair["status"][k] != "refused":
            out.append({**mark(k, "failed"), "x": at})
    return out
def _steps(pair: dict) -> list:
    """The steps of the runs of a pair, as the page takes them from `asked`: h, tol or 1/k."""
    is_k = pair["accuracy"] == "k"
    return [1.0 / value if value and is_k else value for value in pair["asked"]]


def _best(content: Content, case: str, target: float, position: dict[str, int]) -> list | None:
    """The best method at a target: its number, and what it needs where no run reached the error
    (else ""); None where there is none."""
    best = best_of_page(content.data, content.summaries, case, target)
    if best.cost is None:
        return None
    needs = "" if best.reached else format_extrapolated(best.cost)
    return [position[best.cost.solver], needs]


def _label(target: float) -> str:
    """1e-3, and 3e-4 for the half decades."""
    return format_power(float(f"{target:.0e}"))


def _pair(summary: Summary, case: int, method: int) -> dict:
    """One method on one case: its runs by column, its orders, and its cost at every target.

    cost: one entry per target, null where the error is not reached, else [seconds, lower quartile,
    upper quartile, step, 1 if these are upper bounds]. best: the least error that is reached.
    needs: one entry per target, null or [step, seconds] that reach it by extrapolation; [] without
    any. bars: by metric, of those that have some,
    one entry per run: null, or [kind, error bar, error, 1 if that error is measurable], both in the
    2-norm. The page takes the step h of a run from `asked`: 1/k of a run with k.
    """
    runs = summary.runs
    kept = np.unique(np.linspace(0, len(runs) - 1, min(len(runs), MAX_RUNS)).astype(int))
    column = lambda name: _numbers(runs.col[name][kept])
    force = summary.force.metric
    out = {
        "c": case,
        "m": method,
        "word": summary.word,
        "why": summary.outcome,
        "loop": runs.loop,
        "accuracy": runs.accuracy,
        "status": runs.col["status"][kept].tolist(),
        "good": np.isin(runs.col["status"][kept], GOOD).astype(int).tolist(),
        "asked": _all_digits(runs, kept),
        "force": _numbers(np.abs(runs.col[force][kept])),
        "inner": _numbers(counted_inner_work(runs)[kept]),
        "metric": force,
        "trust": summary.force.text,
        "reason": runs.why_reaction,
        "orders": {
            "state": _order(summary.state),
            "force": _order(summary.force),
            "violation": _order(summary.violation),
        },
        "floors": {"state": _number(runs.floor("state_sup")), "force": _number(runs.floor(force))},
        "cost": [_cost(cost_at_error(runs, t)) for t in TARGETS],
        "best": _number(least_error(runs)),
        "needs": _needs(summary),
        "bars": _bars(runs, {"state": "state_sup", "force": force}, kept),
    }
    out |= {key: column(name) for key, name in {**METRICS, **COSTS}.items()}
    return out


def _all_digits(runs: Runs, kept: np.ndarray) -> list:
    """List h, tol or k of the kept runs with all digits, to repeat them; None where unknown."""
    values = runs.col["asked" if runs.accuracy == "k" else "h"][kept]
    return [float(v) if math.isfinite(v) else None for v in values]


def _bars(runs: Runs, columns: dict[str, str], kept: np.ndarray) -> dict[str, list]:
    """Error bars of the kept runs, by metric; columns: the column of each metric."""
    found = {}
    for metric, column in columns.items():
        bars = error_bars(runs, column)
        if any(bars):
            seen = measurable(runs, QUANTITIES[column])
            found[metric] = [_bar(bars[k], seen[k]) for k in kept]
    return found


def _bar(bar: tuple[str, float, float] | None, seen: bool) -> list | None:
    """[kind, error bar, error, is it measurable?] of a run, null for one without a bar."""
    return None if bar is None else [bar[0], _number(bar[1]), _number(bar[2]), int(seen)]


def _order(order: Order) -> list | None:
    """[order, low, high, claim, verdict] of a fit, null for anything else."""
    if order.kind != "fit":
        return None
    numbers = (order.order, *order.interval, order.claim)
    return [*(_number(v) for v in numbers), order.verdict]


def _cost(cost: Cost | None) -> list | None:
    if cost is None:
        return None
    numbers = (cost.seconds, cost.low, cost.high, cost.h)
    return [*(_number(v) for v in numbers), int(cost.at_most)]


def _needs(summary: Summary) -> list:
    """[step, seconds] that reach each target by extrapolation, null where none are known; [] where
    none is known at all."""
    found = [extrapolate_cost(summary, t) for t in TARGETS]
    known = [c is not None and c.seconds > 0.0 for c in found]
    if not any(known):
        return []
    each = zip(found, known, strict=True)
    return [[_number(c.h), _number(c.seconds)] if k else None for c, k in each]


def _numbers(values: np.ndarray) -> list:
    return [_number(v) for v in values]


def _number(value: float | None) -> float | None:
    """Round to DIGITS significant digits; None for what is no number."""
    if value is None or not math.isfinite(value):
        return None
    return float(f"{value:.{DIGITS - 1}e}")

