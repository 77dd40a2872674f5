"""Facts of a study: the orders, errors, counted work and statuses that a baseline can hold.

Orders, constants and verdicts of every method on every case, errors, residuals and counted work of
one step in the middle of its ladder, and how many of its runs ended with which status. Which
columns are held, and how, is told by the table of columns (`nsbench.columns`, field `gate`).
"""

from __future__ import annotations

import hashlib
import json
import math
from collections import Counter
from dataclasses import dataclass

import numpy as np

from nsbench.columns import held_by_gate
from nsbench.columns.column import Column
from nsbench.measure.orders.window import TOLERANCE, left_open, rounding
from nsbench.report.claims import claimed, rounding_span, run_length
from nsbench.report.data import GOOD, Data, Runs
from nsbench.report.summary import Order, Summary, format_statuses, summarise

KINDS = ("near", "max", "min", "class", "count")
UNITS = {"order": "1", "constant": "error/h^order"}
SMALL = 1e-9  # residuals below it are rounding: they are held from above, not near a value
ORDER_ROUNDING = 1e-9  # of an order: its interval is no narrower than what rounding makes of errors
RESIDUAL_ROUNDING = 1e-12  # of the size of the solution: absolute tolerance of a residual


@dataclass(frozen=True)
class Fact:
    """One number, or word, of one method on one case.

    parameters: the accuracy of one run such as ``h=0.00125``, or ``ladder`` for what the whole
    ladder says. kind: how it is compared (near: within its tolerances of a value; max, min: not
    beyond it; class: the same word; count: the same number). floor: below it a value says nothing.
    config: words ``what=digest`` of all that may change it but is no code. claim: the error that
    the method claims here, or, where it claims none, up to which a value is held from above alone;
    0: the floor.
    """

    case: str
    solver: str
    parameters: str
    metric: str
    kind: str
    value: float | str
    unit: str
    config: str
    floor: float = 0.0
    claim: float = 0.0

    @property
    def key(self) -> tuple[str, str, str, str]:
        return self.case, self.solver, self.parameters, self.metric


def facts(data: Data) -> dict[tuple, Fact]:
    """Every fact of a study by its key, in the order of the page."""
    out = {}
    for s in summarise(data).values():
        config = configuration(data, s.runs)
        for f in (*_ladder(s, config), *_middle(data, s.runs, config)):
            out[f.key] = f
    return out


def configuration(data: Data, runs: Runs) -> str:
    """Case, reference, solver and ladder as short digests: what a number depends on beside the code
    of the package."""
    case = data.cases.get(runs.case, {})
    solver = data.solvers.get(runs.solver, {})
    asked = sorted(float(v) for v in runs.col["asked"] if math.isfinite(v))
    parts = {
        "case": case.get("digest", ""),
        "reference": case.get("reference_digest", ""),
        "solver": solver.get("digest", ""),
        "ladder": [f"{v:.12g}" for v in asked],
    }
    return " ".join(f"{name}={digest(value)}" for name, value in parts.items())


def digest(value) -> str:
    """Six hexadecimal digits of anything that JSON can hold."""
    return hashlib.sha256(json.dumps(value, sort_keys=True, default=str).encode()).hexdigest()[:6]


def _ladder(s: Summary, config: str):
    """What the whole ladder says: how its runs ended, and of state and force the verdict, and the
    order, half the width of its interval and the constant, or the plateau."""

    def fact(
        metric: str, kind: str, value: str | float, unit: str = "", floor: float = 0.0
    ) -> Fact:
        return Fact(s.case, s.solver, "ladder", metric, kind, value, unit, config, floor)

    yield fact("statuses", "class", format_statuses(_ended(s.statuses)))
    for name, order in (("state", s.state), ("force", s.force)):
        if s.outcome or order.kind == "none":
            continue
        yield fact(f"{name} verdict", "class", _verdict(order))
        if order.kind == "fit" and order.verdict == "order":
            yield fact(f"{name} order", "near", order.order, UNITS["order"])
            yield fact(f"{name} constant", "near", order.constant, UNITS["constant"])
            half_width = 0.5 * (order.interval[1] - order.interval[0])
            if math.isfinite(half_width):
                metric = f"{name} half-width"
                yield fact(metric, "near", half_width, UNITS["order"], ORDER_ROUNDING)
        elif order.verdict == "plateau":
            yield fact(f"{name} plateau", "near", order.plateau)


def _ended(statuses: Counter) -> Counter:
    """Runs by status; whether a reference can tell the error from zero is no way to end."""
    out = Counter()
    for code, n in statuses.items():
        out["ok" if code in GOOD else code] += n
    return out


def _verdict(order: Order) -> str:
    """One word for what the fit says; a claimed bound is kept or not, if the reference can tell."""
    if order.kind == "bound":
        if order.verdict == "below reference":
            return order.verdict
        return "bound missed" if order.flag == "below" else "bound kept"
    return order.verdict or order.kind


def _middle(data: Data, runs: Runs, config: str):
    """Errors, residuals and work of the run in the middle of the ladder, by what was asked for."""
    asked = np.where(np.isfinite(runs.col["asked"]), runs.col["asked"], np.inf)
    if not np.isfinite(asked).any():
        return
    at = int(np.argsort(asked, kind="stable")[np.isfinite(asked).sum() // 2])
    parameters = f"{runs.accuracy}={asked[at]:.6g}"

    def fact(metric: str, kind: str, value: str | float, *levels: float) -> Fact:
        return Fact(
            runs.case, runs.solver, parameters, metric, kind, value, "", config, *levels
        )

    yield fact("status", "class", "ok" if runs.good[at] else str(runs.col["status"][at]))
    if not runs.good[at]:
        return
    if runs.col["lam_time"][at]:
        yield fact("lam_time", "class", str(runs.col["lam_time"][at]))
    for column in held_by_gate():
        value = float(runs.col[column.name][at])
        if not math.isfinite(value):
            continue
        if column.gate == "count":
            yield fact(column.name, "count", value)
            continue
        near, above, least = _levels(data, runs, column, at)
        kind = _kind_of(column, value, least)
        claim = _claim_of(data, runs, column, at) or least
        floor = min(near if kind == "near" else above, claim)
        yield fact(column.name, kind, value, floor, claim)


def _kind_of(column: Column, value: float, least: float) -> str:
    """How a number is held: beyond `least` near its value, else on one side alone.

    A number that may be negative (gate "min") is held from below there.
    """
    if column.gate == "min":
        return "near" if abs(value) > least else "min"
    return "near" if column.gate == "near" and value > least else "max"


def _levels(data: Data, runs: Runs, column: Column, at: int) -> tuple[float, float, float]:
    """Three levels of a column in the run `at`: the floor of a number that is held near a value,
    the floor of one that is held from above, and the level up to which it is held so.

    Errors that the reference cannot tell, that rounding can make, or that the tolerance leaves open
    are held from above alone.
    """
    scale = runs.scale(column.name)
    if column.group == "residual":
        floor = RESIDUAL_ROUNDING * scale
        return floor, floor, max(SMALL, floor)
    h = runs.col["h"][at]
    span = rounding_span(data, runs.case, runs.solver)
    floor = max(runs.floor(column.name), float(rounding(h, scale, span, runs.accuracy)))
    level = floor + float(left_open(h, scale, runs.accuracy))
    return floor, level, level


def _claim_of(data: Data, runs: Runs, column: Column, at: int) -> float:
    """The error that the method claims in the run `at`, 0 where it claims none.

    A bound is claimed at the tightest tolerance, relative to the size of what is wrong; at a larger
    one it is as many times larger. An order p is claimed as size (h / T)^p. No method claims less
    than rounding.
    """
    if column.group != "error":
        return 0.0
    of_state = column.scale == "state_scale"
    size = runs.scale(column.name)
    h = runs.col["h"]
    bound = claimed(data, runs.solver, "exact")
    order = claimed(data, runs.solver, "state" if of_state else "impulse")
    if bound:
        looser = float(h[at] / np.nanmin(h)) if runs.accuracy == TOLERANCE else 1.0
        claim = bound * looser * size
    elif order:
        claim = size * float(h[at] / run_length(data, runs.case)) ** order
    else:
        return 0.0
    span = rounding_span(data, runs.case, runs.solver)
    return max(claim, float(rounding(h[at], size, span, runs.accuracy)))
