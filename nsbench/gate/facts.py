"""Facts: the numbers and words of a study that a baseline can hold.

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
from nsbench.measure.orders.window import rounding
from nsbench.report.data import GOOD, Data, Runs
from nsbench.report.summary import (
    Order,
    Summary,
    format_statuses,
    length_of_run,
    summarise,
)

KINDS = ("near", "max", "min", "class", "count")
UNITS = {"order": "1", "constant": "error/h^order"}
SMALL = 1e-9  # residuals below it are rounding: they are held from above, not near a value
RESIDUAL_ROUNDING = 1e-12  # of the size of the solution: absolute tolerance of a residual


@dataclass(frozen=True)
class Fact:
    """One number, or word, of one method on one case.

    parameters: the accuracy of one run such as ``h=0.00125``, or ``ladder`` for what the whole
    ladder says. kind: how it is compared (near: within its tolerances of a value; max, min: not
    beyond it; class: the same word; count: the same number). floor: below it a value says nothing.
    config: words ``what=digest`` of all that may change it but is no code.
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

    @property
    def key(self) -> tuple[str, str, str, str]:
        return self.case, self.solver, self.parameters, self.metric


def facts(data: Data) -> dict[tuple, Fact]:
    """Every fact of a study by its key, in the order of the page."""
    out = {}
    for s in summarise(data).values():
        config = configuration(data, s.runs)
        for f in (
            *_ladder(s, config),
            *_middle(s.runs, config, length_of_run(data.cases.get(s.case, {}))),
        ):
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
    """What the whole ladder says: how its runs ended, verdict, order and constant of the state and
    of the force."""

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
        elif order.verdict == "plateau":
            yield fact(f"{name} plateau", "near", order.plateau)


def _ended(statuses: Counter) -> Counter:
    """Runs by status; whether a reference can tell the error from zero is no way to end."""
    out = Counter()
    for code, n in statuses.items():
        out["ok" if code in GOOD else code] += n
    return out


def _verdict(order: Order) -> str:
    """One word for what the fit says; a claimed bound is kept or not."""
    if order.kind == "bound":
        return "bound missed" if order.flag == "below" else "bound kept"
    return order.verdict or order.kind


def _middle(runs: Runs, config: str, span: float):
    """Errors, residuals and work of the run in the middle of the ladder, by what was asked for.

    Errors that the reference cannot tell, or that rounding over `span` can make, are held from
    above alone.
    """
    asked = np.where(np.isfinite(runs.col["asked"]), runs.col["asked"], np.inf)
    if not np.isfinite(asked).any():
        return
    at = int(np.argsort(asked, kind="stable")[np.isfinite(asked).sum() // 2])
    parameters = f"{runs.accuracy}={asked[at]:.6g}"

    def fact(
        metric: str, kind: str, value: str | float, unit: str = "", floor: float = 0.0
    ) -> Fact:
        return Fact(runs.case, runs.solver, parameters, metric, kind, value, unit, config, floor)

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
        scale = runs.scale(column.name)
        if column.group == "residual":
            least = SMALL
            floor = RESIDUAL_ROUNDING * scale
        else:
            floor = max(runs.floor(column.name), float(rounding(runs.col["h"][at], scale, span)))
            least = floor
        kind = "near" if column.gate == "near" and value > least else "max"
        yield fact(column.name, kind, value, floor=floor)
