"""Charts of the rows of a study: errors over the step, errors over a cost, orders."""

from __future__ import annotations

import math

import numpy as np

from nsbench.plots.chart import Chart, chart_of
from nsbench.report.charts.layouts import error_chart, order_chart
from nsbench.report.cost import counted_inner_work
from nsbench.report.data import Data, Runs, read
from nsbench.report.figures import STEP_LABEL
from nsbench.report.style import Look, assign_looks
from nsbench.report.summary import Order, summarise

ERROR_TITLES = {
    "state_sup": "error of the state",
    "impulse": "error of the impulse",
    "reaction": "error of the reaction",
    "feasibility": "largest violation",
}
COST_TITLES = {
    "seconds": "seconds of one run",
    "drift_calls": "drift calls",
    "inner": "projections or inner iterations",
}


class StudyPlots:
    """Charts of a study, as `study.plot`."""

    def __init__(self, study: object):
        self._data: Data = read(study)
        self._looks: list[tuple[str, Look]] = list(assign_looks(self._data.specs).items())

    def __repr__(self) -> str:
        """Return the charts that there are."""
        return "StudyPlots(error, work_precision, orders)"

    def error(self, case: str | None = None, metric: str = "state_sup") -> Chart:
        """Draw an error over the step of one case; case: None: the first one.

        metric: a column, such as state_sup, impulse, reaction or feasibility. Raises LookupError
        for another case or column, ValueError if no run has a number.
        """
        runs = self._runs_of(case, metric)
        rows = [row for r in runs for row in error_rows(r, r.col["h"], metric)]
        return chart_of(error_chart(self._looks, STEP_LABEL, title_of(metric)), rows)

    def work_precision(
        self, case: str | None = None, metric: str = "state_sup", cost: str = "seconds"
    ) -> Chart:
        """Draw an error over what it costs; cost: "seconds", "drift_calls" or "inner".

        Methods with a tolerance are curves here too. Raises as `error` does.
        """
        if cost not in COST_TITLES:
            raise LookupError(f"no cost {cost!r}; one of {', '.join(COST_TITLES)}")
        runs = self._runs_of(case, metric)
        price = {r.solver: counted_inner_work(r) if cost == "inner" else r.col[cost] for r in runs}
        rows = [row for r in runs for row in error_rows(r, price[r.solver], metric, level=False)]
        return chart_of(error_chart(self._looks, COST_TITLES[cost], title_of(metric)), rows)

    def orders(self, which: str = "state") -> Chart:
        """Draw all fitted orders with their 95 % intervals; which: "state", "force", "violation".

        Raises LookupError for another word, ValueError if nothing has an order.
        """
        if which not in ("state", "force", "violation"):
            raise LookupError(f"no orders of {which!r}; state, force or violation")
        found = {pair: getattr(s, which) for pair, s in summarise(self._data).items()}
        rows = [order_row(*pair, order) for pair, order in found.items() if order.kind == "fit"]
        title = f"order of convergence of the {which}"
        return chart_of(order_chart(self._looks, title, len({r["case"] for r in rows})), rows)

    def _runs_of(self, case: str | None, metric: str) -> list[Runs]:
        """Return the runs of a case; LookupError if the study has neither case nor column."""
        keys = self._data.case_keys
        case = keys[0] if case is None and keys else case
        if case not in keys:
            raise LookupError(f"no case {case!r} in this study; it has {', '.join(keys) or 'none'}")
        runs = self._data.of_case(case)
        if any(metric not in r.col for r in runs):
            raise LookupError(f"no column {metric!r} in this study")
        return runs


def title_of(metric: str) -> str:
    """Return the title of an axis that shows a column."""
    return ERROR_TITLES.get(metric, metric)


def error_rows(runs: Runs, x: np.ndarray, metric: str, level: bool = True) -> list[dict]:
    """Rows of the layout `error_chart`: one for each run that has an error, and one for each zero.

    x (runs,): abscissa. level: draw a method with a tolerance as the level of its best error.
    """
    y = np.abs(runs.col[metric])
    use = runs.good & np.isfinite(y) & np.isfinite(x) & (x > 0)
    common = {"method": runs.solver, "status": "ok", "why": ""}
    if level and runs.accuracy == "tol":
        best = y[use & (y > 0)]
        return [{**common, "kind": "level", "y": float(best.min())}] if best.size else []
    return [
        {
            **common,
            "kind": "error" if y[i] > 0 else "zero",
            "x": float(x[i]),
            "y": float(y[i]),
            "h": float(runs.col["h"][i]),
            "seconds": _number(runs.col["seconds"][i]),
        }
        for i in np.flatnonzero(use)
    ]


def order_row(case: str, method: str, order: Order) -> dict:
    """Return the row of the layout `order_chart`."""
    low, high = order.interval
    return {"case": case, "method": method, "x": order.order, "low": low, "high": high}


def _number(value: float) -> float | None:
    """JSON has no NaN."""
    return float(value) if math.isfinite(value) else None
