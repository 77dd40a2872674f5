"""The opening sentences: which method, which multipliers, what failed; every figure is computed
from the rows."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np

from nsbench.report import cost
from nsbench.report.data import Data
from nsbench.report.expectations import judge_expectations, new_deviations, resolved_deviations
from nsbench.report.style import (
    LEADING_METHOD,
    format_count,
    format_factor,
    format_number,
    format_power,
    join_names,
)
from nsbench.report.summary import OPEN, Order, Summary, find_silent_failures, format_statuses

MAX_DEVIATIONS = 12  # deviations told in the opening; the table has them all


@dataclass(frozen=True)
class Statement:
    """A short heading with its sentences; tone: plain or bad."""

    head: str
    sentences: tuple[str, ...]
    tone: str = "plain"


def write_verdict(data: Data, summaries: dict[tuple, Summary]) -> list[Statement]:
    """What a reader in a hurry should take away; at least one statement, also when nothing ran."""
    if not any(s.word == "ok" for s in summaries.values()):
        return [Statement("No run gave a number", (_runs(summaries), *_failed(summaries)), "bad")]
    parts = [
        Statement("Which method", tuple(_choices(data))),
        Statement("Which orders", tuple(_orders(summaries))),
        Statement("Can the multipliers be trusted", tuple(_multipliers(summaries))),
        Statement("Which step", tuple(_violations(data, summaries))),
        Statement("At equal error", tuple(compare_speeds(data))),
    ]
    parts += _unexpected(judge_expectations(data, summaries))
    wrong = find_silent_failures(summaries)
    if wrong:
        parts.append(
            Statement(
                "Wrong without a word",
                tuple(f"{s.solver} on {s.case}, called ok: {s.state.sentence}" for s in wrong),
                "bad",
            )
        )
    parts.append(Statement("What failed", (_runs(summaries), *_failed(summaries))))
    return [p for p in parts if p.sentences]


def _unexpected(found) -> list[Statement]:
    """New deviations from what the methods declare, and known ones that are gone: the same
    statement for both."""
    told = [
        f"{f.solver} on {f.case}, {f.metric}: {f.expected} was expected, {f.observed} is seen."
        for f in new_deviations(found)
    ]
    told += [
        f"{f.solver} on {f.case}, {f.metric}: known to be “{was}”, is seen as {f.observed}: the "
        "table of known deviations is out of date."
        for f, was, _ in resolved_deviations(found)
    ]
    rest = (
        [f"{len(told) - MAX_DEVIATIONS} more: see the table."] if len(told) > MAX_DEVIATIONS else []
    )
    return [Statement("Not as expected", (*told[:MAX_DEVIATIONS], *rest), "bad")] if told else []


def _choices(data: Data):
    cases = [case for case in data.case_keys if _has_error(data, case)]
    for target in cost.TARGETS:
        found = {case: cost.rank_costs(data, case, target) for case in cases}
        if not any(found.values()):
            yield f"Error {format_power(target)}: reached by no method on any case."
            continue
        first = Counter(c[0].solver for c in found.values() if c)
        best = ", ".join(f"{solver} on {n}" for solver, n in first.most_common(4))
        missed = [case for case, c in found.items() if not c]
        tail = f"; not reached on {join_names(missed, 4)}" if missed else ""
        yield (
            f"Error {format_power(target)}: cheapest is {best} of "
            f"{format_count(len(cases), 'case')}{tail}."
        )
    blind = [case for case in data.case_keys if case not in cases]
    if blind:
        yield (
            "Nothing to compare with, for want of a reference or of a finished run: "
            f"{join_names(blind)}."
        )


def _has_error(data: Data, case: str) -> bool:
    return any(np.isfinite(r.col["state_sup"][r.good]).any() for r in data.of_case(case))


def _by_solver(summaries) -> dict[str, list[Summary]]:
    out: dict = {}
    for s in summaries.values():
        if s.word == "ok":
            out.setdefault(s.solver, []).append(s)
    return out


def _spread(orders: list[Order]) -> str:
    """``1.00`` or ``0.97 to 1.02`` with the number of cases."""
    values = [o.order for o in orders]
    low = f"{min(values):.2f}"
    high = f"{max(values):.2f}"
    return f"{low if low == high else f'{low} to {high}'} ({format_count(len(values), 'case')})"


def _pairs(group: list[tuple[Summary, Order]], tell) -> str:
    """``pbd on tide (0.52) and hex (plateau at 2e-3)``, every method once; beyond a dozen only
    counted."""
    by: dict = {}
    for s, o in group:
        by.setdefault(s.solver, []).append(f"{s.case} ({tell(o)})" if tell(o) else s.case)
    return "; ".join(f"{solver} on {join_names(cases, 4)}" for solver, cases in by.items())


def _told(o: Order) -> str:
    if o.kind == "bound":
        return o.text
    if o.verdict == "plateau" and o.plateau == o.plateau:
        return f"plateau at {format_number(o.plateau)}"
    return f"order {o.order:.2f}"


def _orders(summaries):
    solvers = _by_solver(summaries)
    pairs = [(s, s.state) for s in summaries.values() if s.word == "ok"]
    fits = {
        name: [s.state for s in group if s.state.verdict == "order"]
        for name, group in solvers.items()
    }
    kept = {
        name: f
        for name, f in fits.items()
        if f and f[0].claim is not None and not any(o.flag for o in f)
    }
    for claim in sorted({f[0].claim for f in kept.values()}):
        told = "; ".join(f"{name} {_spread(f)}" for name, f in kept.items() if f[0].claim == claim)
        yield f"State order {format_number(claim)}, as claimed, wherever it can be fitted: {told}."
    free = [f"{name} {_spread(f)}" for name, f in fits.items() if f and f[0].claim is None]
    if free:
        yield f"State order where none is claimed: {'; '.join(free)}."
    for head, test in (
        ("Below the claim", lambda o: o.kind == "fit" and o.flag == "below"),
        ("Above the claim", lambda o: o.kind == "fit" and o.flag == "above"),
        (
            "A limit of its own, or none",
            lambda o: o.verdict in ("plateau", "diverges") and not o.flag,
        ),
    ):
        found = [(s, o) for s, o in pairs if test(o)]
        if found:
            yield f"{head}: {_pairs(found, _told)}."
    for name, group in solvers.items():
        bounds = [s.state for s in group if s.state.kind == "bound"]
        if bounds:
            missed = [(s, s.state) for s in group if s.state.kind == "bound" and s.state.flag]
            blind = [
                s.case
                for s in group
                if s.state.kind == "bound" and s.state.verdict == "below reference"
            ]
            tail = (
                f"; missed on {join_names([f'{s.case} ({_told(o)})' for s, o in missed], 4)}"
                if missed
                else ""
            )
            tail += (
                f"; the reference is not good enough to tell on {join_names(blind, 4)}"
                if blind
                else ""
            )
            yield (
                f"{name}: the bound it claims, {format_number(bounds[0].claim)}, is kept on "
                f"{len(bounds) - len(missed) - len(blind)} of "
                f"{format_count(len(bounds), 'case')}{tail}."
            )
    exact = list(dict.fromkeys(s.case for s, o in pairs if o.kind == "exact"))
    if exact:
        yield (
            "Exact at grid times for at least one method, hence no order there: "
            f"{join_names(exact)}."
        )
    open_ = [s for s, o in pairs if o.verdict in OPEN]
    if open_:
        cases = join_names(dict.fromkeys(s.case for s in open_), 4)
        yield (
            f"No verdict (undecided or pre-asymptotic): {len(open_)} of "
            f"{format_count(len(pairs), 'pair')}, on {cases}."
        )


def _multipliers(summaries):
    solvers = _by_solver(summaries)
    pairs = [(s, s.force) for s in summaries.values() if s.word == "ok"]
    for metric in ("impulse", "reaction"):
        sure = {
            name: [
                s.force
                for s in group
                if s.force.metric == metric
                and s.force.verdict == "order"
                and s.force.interval[0] > 0
            ]
            for name, group in solvers.items()
        }
        told = [f"{name} {_spread(f)}" for name, f in sure.items() if f]
        if told:
            yield f"The {metric} converges, with order: {'; '.join(told)}."
    exact = [(s, o) for s, o in pairs if o.kind == "exact"]
    if exact:
        yield f"Exact: {_pairs(exact, lambda o: '')}."
    doubt = [(s, o) for s, o in pairs if o.verdict in ("plateau", "diverges")]
    if doubt:
        yield f"Do not trust: {_pairs(doubt, _told)}."
    elif pairs:
        yield "No multiplier was found to level off or to diverge."
    open_ = [s for s, o in pairs if o.verdict in OPEN]
    if open_:
        cases = join_names(dict.fromkeys(s.case for s in open_), 4)
        yield (
            f"No verdict (undecided or pre-asymptotic): {len(open_)} of "
            f"{format_count(len(pairs), 'pair')}, on {cases}."
        )
    loose = sorted({s.case for s in summaries.values() if s.force.metric == "reaction"})
    if loose:
        yield (
            f"Not unique, so that only the reaction can be compared: {join_names(loose)}. Which "
            "multiplier a method picks there is a selection, not an error."
        )


def _violations(data: Data, summaries):
    """Which step keeps the constraints, and the case that asks for it: one sentence per figure."""
    for target in (1e-2, 1e-3):
        told = []
        missed = []
        for solver, group in _by_solver(summaries).items():
            found = {
                s.case: cost.step_for_violation(s.runs, target) for s in group if s.runs.violates
            }
            steps = [(c.h, case) for case, c in found.items() if c is not None and c.h > 0]
            if steps:
                h, case = min(steps)
                told.append(f"{solver} h = {format_number(h)} ({case})")
            missed += [f"{solver} on {case}" for case, c in found.items() if c is None]
        if told:
            tail = f"; not reached by {join_names(missed, 4)}" if missed else ""
            yield (
                f"Violation below {format_power(target)} on every case that reaches it: "
                f"{', '.join(told)}{tail}."
            )


def compare_speeds(data: Data):
    """Factors over PBD at equal error, between loops of one kind, and the talk's factor of 100."""
    qp = cost.find_qp_methods(data)
    ratios = {}
    apart = set()
    for case in data.case_keys:
        for target in cost.TARGETS:
            found = cost.rank_costs(data, case, target)
            base = cost.select_baseline(found)
            for c in found:
                if base is None or c.solver == base.solver:
                    continue
                r = cost.ratio_of_seconds(c, base)
                if r is None and c.loop != base.loop:
                    apart.add(c.solver)
                elif r is not None:
                    ratios.setdefault(c.solver, []).append((r, case, target))
    for solver, group in ratios.items():
        values = [r for r, _, _ in group]
        yield (
            f"{solver} takes {format_factor(float(np.median(values)))} times the seconds of "
            f"{LEADING_METHOD} (median of {format_count(len(values), 'comparison')}; "
            f"{format_factor(min(values))} to {format_factor(max(values))})."
        )
    apart -= set(ratios)
    if apart:
        yield (
            f"Seconds of {join_names(sorted(apart))} are not compared with {LEADING_METHOD}: their "
            "loops are of another kind, or their coarsest run was already better."
        )
    gains = [g for solver in qp for g in ratios.get(solver, [])]
    if gains:
        top, case, target = max(gains)
        seen = "was seen" if top >= 100 else "was not seen"
        yield (
            f"The talk's factor of 100 over stepping with an inner QP {seen} at equal error: at "
            f"most {format_factor(top)} times ({case} at {format_power(target)}), at least "
            f"{format_factor(min(gains)[0])}."
        )


def _runs(summaries) -> str:
    total = sum((s.statuses for s in summaries.values()), Counter())
    good = total.pop("ok", 0)
    below = total.pop("below_reference", 0)
    refused = total.pop("refused", 0)
    text = f"Of {format_count(good + below + refused + sum(total.values()), 'run')} {good} ended ok"
    text += f", {below} below the reference's own error" if below else ""
    text += f", {refused} refused by the method" if refused else ""
    return text + (
        f", {sum(total.values())} failed: {format_statuses(total)}." if total else ", none failed."
    )


def _failed(summaries):
    for solver in dict.fromkeys(s.solver for s in summaries.values()):
        never = [s.case for s in summaries.values() if s.solver == solver and s.word == "failed"]
        some = [
            s.case
            for s in summaries.values()
            if s.solver == solver
            and s.word == "ok"
            and set(s.statuses) - {"ok", "below_reference", "refused"}
        ]
        if never:
            yield f"{solver} gave no number on {join_names(never)}."
        if some:
            yield f"{solver} failed at some accuracies on {join_names(some)}."
