"""Summarise every method on every case: the order of each error, and the best error.

Where there is no order, the reason is given instead: too few steps, no reference, a status.
"""

from __future__ import annotations

import functools
import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from nsbench.columns import RELATIVE, describe
from nsbench.report.claims import claims_on, rounding_span
from nsbench.report.data import GOOD, Data, Runs
from nsbench.report.style import format_count, format_number, sanitise

OPEN = ("undecided", "pre-asymptotic")
MIN_STEPS = 3  # distinct step sizes that an order needs
MAX_FITTED_RUNS = 500  # in one fit; more are thinned evenly, and the sentence reports it
MAX_INTERVAL_WIDTH = 2.0  # of an order without a verdict: beyond it the number has no meaning
CLAIM_TOLERANCE = 0.1  # an order this close to the claim is no deviation


@dataclass(frozen=True)
class Order:
    """The behaviour of one metric of one method on one case as the accuracy parameter goes to zero.

    kind: fit (order, interval and constant are numbers), bound (a claimed bound instead of an
    order), exact (rounding at every step), level (a best error without an order), none (no number).
    text: for the table; sentence: complete. flag: "above" or "below" the claim, else "". best,
    best_h: the smallest error and its step. window: steps (coarse, fine) that were fitted. plateau:
    limit of the error; envelope: see nsbench.measure.orders.
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
    """One method on one case.

    force: of the impulse, or the reaction where that alone is unique or known; settled: of
    multipliers at single times, as means over a sample interval away from events.
    outcome: the sentence that replaces all numbers where no run gave one, else "".
    """

    runs: Runs
    state: Order
    force: Order
    violation: Order
    settled: Order
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
        """Classify the pair: "refused", "failed" or "ok"."""
        if not self.outcome:
            return "ok"
        return "refused" if set(self.statuses) == {"refused"} else "failed"


def summarise(data: Data) -> dict[tuple[str, str], Summary]:
    """Summarise every case x solver of the study, in the order of the page.

    Pairs that were never attempted are absent.
    """
    from nsbench.measure import fit_order

    by_reaction = {case for (case, _), r in data.runs.items() if r.compared == "reaction"}
    out = {}
    for (case, solver), runs in data.runs.items():
        claims = claims_on(data, case, solver)
        force = "reaction" if case in by_reaction else "impulse"
        statuses = Counter(runs.col["status"].tolist())
        fit = functools.partial(fit_order, span=rounding_span(data, case, solver))
        out[case, solver] = Summary(
            runs,
            estimate_order(runs, "state_sup", claims, fit),
            estimate_order(runs, force, claims, fit),
            estimate_order(runs, "feasibility", {}, fit),
            estimate_order(runs, "settled", {}, fit),
            statuses,
            _outcome(runs, statuses),
        )
    return out


def without_refusals(summaries: dict[tuple[str, str], Summary]) -> dict[tuple[str, str], Summary]:
    """Leave refusals out of the summaries of a single case: their section names them once.

    Of several cases all are kept, since tables show which methods take which cases.
    """
    if len({case for case, _ in summaries}) > 1:
        return summaries
    return {key: s for key, s in summaries.items() if s.word != "refused"}


def _outcome(runs: Runs, statuses: Counter) -> str:
    """The reason why no run gave a number: the commonest status with its sentence."""
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
    """Format counted statuses: ``3 diverged, 1 timeout``."""
    return ", ".join(f"{n} {code or 'without status'}" for code, n in statuses.most_common())


def estimate_order(runs: Runs, metric: str, claims: dict, fit: Callable) -> Order:
    """Estimate the order of `metric`, or give the reason why there is none.

    claims: of the solver. fit: nsbench.fit_order with the length of the run.
    """
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
        return _bound(runs, metric, bound, error, h, best)
    steps = np.unique(h).size
    if steps < MIN_STEPS:
        return Order(
            metric,
            "level",
            "too few steps",
            f"{name}: {format_count(steps, 'step size')} with a number; an order needs {MIN_STEPS} "
            f"at least. Smallest error {format_error(best['best'], runs.floor(metric))}.",
            **best,
        )
    if not error.any():
        sentence = f"{name}: the error is exactly 0 at every step: no order."
        return Order(metric, "exact", "0 at every step", sentence, **best)
    return _fit(runs, metric, h, error, fit, claim, best)


def _fit(
    runs: Runs,
    metric: str,
    h: np.ndarray,
    error: np.ndarray,
    fit: Callable,
    claim: float | None,
    best: dict[str, float],
) -> Order:
    """Fit an order to the errors (k,) at steps h (k,) and compare it with the claim."""
    sample = np.unique(np.linspace(0, h.size - 1, min(h.size, MAX_FITTED_RUNS)).astype(int))
    result = fit(
        h[sample],
        error[sample],
        floor=runs.floor(metric),
        scale=runs.scale(metric),
        accuracy=runs.accuracy,
    )
    verdict = sanitise(result.verdict)
    sentence = f"{describe(metric).title}: {sanitise(result.sentence)}"
    if sample.size < h.size:
        sentence += f" ({sample.size} of {h.size} runs were fitted.)"
    value = float(result.order)
    if not math.isfinite(value):
        kind = "exact" if verdict.startswith("exact") else "level"
        return Order(metric, kind, verdict, sentence, verdict=verdict, **best)
    flag = _deviation(value, result.interval, verdict, claim)
    if flag:
        sentence += f" Claimed: {format_number(claim)}; measured {flag} it."
    lo, hi = (float(v) for v in result.interval)
    if verdict in OPEN and not hi - lo <= MAX_INTERVAL_WIDTH:
        return Order(metric, "level", verdict, sentence, verdict=verdict, **best)
    doubt = f" {verdict}" if verdict in OPEN else ""
    return Order(
        metric=metric,
        kind="fit",
        text=f"{value:.2f} [{lo:.2f}, {hi:.2f}]{doubt}",
        sentence=sentence,
        order=value,
        interval=(lo, hi),
        constant=float(result.constant),
        verdict=verdict,
        flag=flag,
        claim=claim,
        plateau=float(result.plateau),
        window=tuple(map(float, result.window)),
        envelope=float(result.envelope),
        **best,
    )


def _deviation(value: float, interval, verdict: str, claim) -> str:
    """Compare an order with the claim: "above", "below", or "".

    It is "" where the claim is kept or missing, and where the fit gives no verdict.
    """
    if claim is None:
        return ""
    if verdict in ("diverges", "plateau"):
        return "below"
    if (
        verdict != "order"
        or abs(value - claim) <= CLAIM_TOLERANCE
        or interval[0] <= claim <= interval[1]
    ):
        return ""
    return "above" if value > claim else "below"


def format_error(value: float, floor: float) -> str:
    """Format an error, or the floor of its reference where the error lies below it."""
    return f"< {format_number(floor)}" if value < floor else format_number(value)


def _bound(
    runs: Runs,
    metric: str,
    bound: float | None,
    error: np.ndarray,
    h: np.ndarray,
    best: dict[str, float],
) -> Order:
    """Compare the error at the tightest tolerance with the bound that the method claims.

    The bound is of the error relative to the size of what it is the error of, as in the texts.
    """
    name = describe(metric).title
    if bound is None:
        return Order(
            metric,
            "level",
            "no order in tol",
            f"{name}: the accuracy is a tolerance, and no order in it is claimed. Smallest error "
            f"{format_error(best['best'], runs.floor(metric))} at tol = "
            f"{format_number(best['best_h'])}.",
            **best,
        )
    last = runs.relative(metric, float(error[np.argmin(h)]))
    floor = runs.relative(metric, runs.floor(metric))
    if last < floor and floor > bound:
        return Order(
            metric,
            "bound",
            f"< {format_number(floor)}",
            f"{name}: the error is below {format_number(floor)} ({RELATIVE}), ten times the bound "
            f"of the reference: whether the claimed {format_number(bound)} is kept is not known.",
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
        f"{name}: the method claims an error of at most {format_number(bound)} ({RELATIVE}); at "
        f"tol = {format_number(float(h.min()))} it is {text}: {'kept' if kept else 'missed'}.",
        verdict="bound kept" if kept else "bound missed",
        flag="" if kept else "below",
        claim=bound,
        **best,
    )


def _absent(runs: Runs, metric: str, whole: bool = False) -> str:
    """The reason why no run holds a number for `metric`; `whole`: as a sentence."""
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
    """Format the smallest error that a run reached, for a table cell; never empty."""
    runs = summary.runs
    below = runs.col["status"] == "below_reference"
    floor = runs.floor(which.metric)
    if math.isfinite(which.best) and which.best >= floor:
        return format_number(which.best)
    if floor and (below.any() or math.isfinite(which.best)):
        return f"< {format_number(floor)} (reference)"
    return which.text


def find_silent_failures(summaries: dict[tuple[str, str], Summary]) -> list[Summary]:
    """List methods that claim a bound and called a run ok that breaks it."""
    out = []
    for s in summaries.values():
        if s.state.kind == "bound" and s.state.claim is not None:
            col = s.runs.col
            tightest = col["h"] == np.nanmin(col["h"][s.runs.good])
            if np.any(
                (col["status"] == "ok")
                & tightest
                & (s.runs.relative("state_sup", col["state_sup"]) > s.state.claim)
                & ~(col["state_sup"] < s.runs.floor("state_sup"))
            ):
                out.append(s)
    return out


def count_finished(runs: Runs) -> int:
    """Count the runs whose errors are numbers."""
    return int(np.isin(runs.col["status"], GOOD).sum())
