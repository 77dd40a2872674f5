"""Rows -> for every case and solver: the order of each error, the best error, and why there is
none."""

from __future__ import annotations

import functools
import math
from collections import Counter
from dataclasses import dataclass

import numpy as np

from nsbench.columns import describe
from nsbench.report.data import GOOD, Data, Runs
from nsbench.report.style import format_count, format_number, sanitise

OPEN = ("undecided", "pre-asymptotic")
FEWEST = 3  # distinct steps below which nobody can speak of an order
MOST = 500  # runs in one fit; more are thinned evenly, and the sentence says so
VAGUE = 2.0  # width of an interval from which on an order without a verdict is no number to show
MARGIN = (
    0.1  # an order this close to the claim is not called a deviation, however narrow its interval
)


@dataclass(frozen=True)
class Order:
    """What one metric of one method on one case does as the accuracy parameter goes to zero.

    kind: fit (order, interval and constant are numbers), bound (a claimed bound instead of an
    order), exact (rounding at every step), level (a best error without an order), none (no number).
    text is what the table shows, sentence the whole story. flag: "above", "below" (the claim) or
    "".
    """

    metric: str
    kind: str
    text: str
    sentence: str
    order: float = math.nan
    interval: tuple = (math.nan, math.nan)
    constant: float = math.nan
    verdict: str = ""
    flag: str = ""
    claim: float | None = None
    plateau: float = math.nan
    best: float = math.nan
    best_h: float = math.nan
    window: tuple = (math.nan, math.nan)
    envelope: float = math.nan


@dataclass(frozen=True)
class Summary:
    """One case x solver. outcome: the sentence that stands for all numbers where no run gave one,
    else ""."""

    runs: Runs
    state: Order
    force: Order
    violation: Order
    statuses: Counter
    outcome: str

    @property
    def case(self) -> str:
        return self.runs.case

    @property
    def solver(self) -> str:
        return self.runs.solver

    @property
    def word(self) -> str:
        """refused, failed or ok."""
        if not self.outcome:
            return "ok"
        return "refused" if set(self.statuses) == {"refused"} else "failed"


def summarise(data: Data) -> dict[tuple, Summary]:
    """Every case x solver of the study, in the order of the page; pairs never attempted are
    absent."""
    from nsbench.measure import fit_order

    nonunique = {case for (case, _), r in data.runs.items() if not r.unique}
    out = {}
    for (case, solver), runs in data.runs.items():
        claims = data.solvers.get(solver, {}).get("claims") or {}
        force = "reaction" if case in nonunique else "impulse"
        statuses = Counter(runs.col["status"].tolist())
        fit = functools.partial(
            fit_order, span=_span(data.cases.get(case, {})) * claims.get("rounding", 1.0)
        )
        out[case, solver] = Summary(
            runs,
            estimate_order(runs, "state_sup", claims, fit),
            estimate_order(runs, force, claims, fit),
            estimate_order(runs, "feasibility", {}, fit),
            statuses,
            _outcome(runs, statuses),
        )
    return out


def _span(known: dict) -> float:
    """The length of the run, which sets how much rounding can add up; 1 if it is not stored."""
    span = known.get("T")
    return (
        float(span) if isinstance(span, (int, float)) and math.isfinite(span) and span > 0 else 1.0
    )


def _outcome(runs: Runs, statuses: Counter) -> str:
    """Why no run gave a number: the commonest status with its sentence."""
    if runs.good.any():
        return ""
    code = statuses.most_common(1)[0][0]
    whys = [w for s, w in zip(runs.col["status"], runs.col["why"], strict=True) if s == code and w]
    why = whys[0] if whys else "no sentence was recorded"
    if code == "refused":
        return why
    tried = (
        ""
        if len(runs) == 1
        else f" ({format_count(len(runs), 'run')}"
        + (f": {format_statuses(statuses)})" if statuses[code] < len(runs) else ")")
    )
    return f"{code}: {why}{tried}"


def format_statuses(statuses: Counter) -> str:
    """``3 diverged, 1 timeout``."""
    return ", ".join(f"{n} {code or 'without status'}" for code, n in statuses.most_common())


def estimate_order(runs: Runs, metric: str, claims: dict, fit) -> Order:
    """The order of `metric`, or the reason why there is none; `fit` is nsbench.fit_order."""
    name = describe(metric).title
    good = (
        runs.good & np.isfinite(runs.col[metric]) & np.isfinite(runs.col["h"]) & (runs.col["h"] > 0)
    )
    h = runs.col["h"][good]
    error = np.abs(runs.col[metric][good])
    if not h.size:
        return Order(metric, "none", _absent(runs, metric), _absent(runs, metric, whole=True))
    at = int(np.argmin(error))
    best = {"best": float(error[at]), "best_h": float(h[at])}
    claim = claims.get(
        {"state_sup": "state", "impulse": "impulse", "reaction": "impulse"}.get(metric, "")
    )
    bound = claims.get("exact") if metric == "state_sup" else None
    if bound is not None or (runs.accuracy == "tol" and claim is None):
        return _bound(metric, name, bound, error, h, best, runs.floor(metric))
    steps = np.unique(h).size
    if steps < FEWEST:
        return Order(
            metric,
            "level",
            "too few steps",
            f"{name}: {format_count(steps, 'step size')} with a number; an order needs {FEWEST} at "
            f"least. Smallest error {format_error(best['best'], runs.floor(metric))}.",
            **best,
        )
    if not error.any():
        sentence = f"{name}: the error is exactly 0 at every step: no order."
        return Order(metric, "exact", "0 at every step", sentence, **best)
    some = np.unique(np.linspace(0, h.size - 1, min(h.size, MOST)).astype(int))
    result = fit(h[some], error[some], floor=runs.floor(metric), scale=runs.scale(metric))
    verdict = sanitise(result.verdict)
    sentence = f"{name}: {sanitise(result.sentence)}"
    if some.size < h.size:
        sentence += f" ({some.size} of {h.size} runs were fitted.)"
    value = float(result.order)
    if not math.isfinite(value):
        kind = "exact" if verdict.startswith("exact") else "level"
        return Order(metric, kind, verdict, sentence, verdict=verdict, **best)
    flag = _deviation(value, result.interval, verdict, claim)
    if flag:
        sentence += f" Claimed: {format_number(claim)}; measured {flag} it."
    lo, hi = (float(v) for v in result.interval)
    if verdict in OPEN and not hi - lo <= VAGUE:  # neither the order nor the constant says anything
        return Order(metric, "level", verdict, sentence, verdict=verdict, **best)
    return Order(
        metric,
        "fit",
        f"{value:.2f} [{lo:.2f}, {hi:.2f}]",
        sentence,
        value,
        (lo, hi),
        float(result.constant),
        verdict,
        flag,
        claim,
        float(result.plateau),
        **best,
        window=tuple(map(float, result.window)),
        envelope=float(result.envelope),
    )


def _deviation(value: float, interval, verdict: str, claim) -> str:
    """ "above" or "below" the claimed order; "" where it is kept, not claimed, or where the fit
    gives no verdict."""
    if claim is None:
        return ""
    if verdict in ("diverges", "plateau"):
        return "below"
    if verdict != "order" or abs(value - claim) <= MARGIN or interval[0] <= claim <= interval[1]:
        return ""
    return "above" if value > claim else "below"


def format_error(value: float, floor: float) -> str:
    """An error, or the floor of its reference where it lies below: what is below says nothing."""
    return f"< {format_number(floor)}" if value < floor else format_number(value)


def _bound(metric: str, name: str, bound, error, h, best, floor) -> Order:
    """A method that controls its own error: its tightest tolerance against the bound it claims."""
    last = float(error[np.argmin(h)])
    if bound is None:
        return Order(
            metric,
            "level",
            "no order in tol",
            f"{name}: the accuracy is a tolerance, and no order in it is claimed. Smallest error "
            f"{format_error(best['best'], floor)} at tol = {format_number(best['best_h'])}.",
            **best,
        )
    if last < floor and floor > bound:
        return Order(
            metric,
            "bound",
            f"< {format_number(floor)}",
            f"{name}: the error is below {format_number(floor)}, ten times the bound of the "
            f"reference: it cannot tell whether the claimed {format_number(bound)} is kept.",
            verdict="below reference",
            claim=bound,
            **best,
        )
    kept = last <= bound
    text = format_error(last, floor)
    return Order(
        metric,
        "bound",
        f"{text} ≤ {format_number(bound)}"
        if kept
        else f"{format_number(last)} > {format_number(bound)}",
        f"{name}: the method claims an error of at most {format_number(bound)}; at tol = "
        f"{format_number(float(h.min()))} it is {text}: {'kept' if kept else 'missed'}.",
        verdict="bound kept" if kept else "bound missed",
        flag="" if kept else "below",
        claim=bound,
        **best,
    )


def _absent(runs: Runs, metric: str, whole: bool = False) -> str:
    """Why no run holds a number for `metric`; `whole`: as a sentence."""
    if not runs.good.any():
        short = "no finished run"
        why = "no run ended with a number."
    elif (
        np.isin(runs.col["status"][runs.good], ("below_reference",)).all()
        and metric != "feasibility"
    ):
        short = "below reference"
        why = "every error lies below the reference's floor."
    elif metric == "feasibility":
        short = "no constraints"
        why = "no run reports one: the case has no inequality to violate."
    elif not any(runs.col["reference"]) or set(runs.col["reference"]) <= {"", "none"}:
        short = "no reference"
        why = "nothing to compare with: neither an exact solution nor a stored reference."
    else:
        short = "not measured"
        why = "the runs hold no number for it."
    return f"{describe(metric).title}: {why}" if whole else short


def format_best_error(summary: Summary, which: Order) -> str:
    """The smallest error a run reached, for a table cell; never empty."""
    runs = summary.runs
    below = runs.col["status"] == "below_reference"
    floor = runs.floor(which.metric)
    if math.isfinite(which.best) and which.best >= floor:
        return format_number(which.best)
    if floor and (below.any() or math.isfinite(which.best)):
        return f"< {format_number(floor)} (reference)"
    return which.text


def find_silent_failures(summaries: dict) -> list[Summary]:
    """Methods that claim a bound and called a run ok that breaks it."""
    out = []
    for s in summaries.values():
        if s.state.kind == "bound" and s.state.claim is not None:
            col = s.runs.col
            tightest = col["h"] == np.nanmin(col["h"][s.runs.good])
            if np.any(
                (col["status"] == "ok")
                & tightest
                & (col["state_sup"] > s.state.claim)
                & ~(col["state_sup"] < s.runs.floor("state_sup"))
            ):
                out.append(s)
    return out


def count_finished(runs: Runs) -> int:
    return int(np.isin(runs.col["status"], GOOD).sum())
