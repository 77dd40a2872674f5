"""The study `multipliers`: settling, sweeps against steps at equal cost, and error bars."""

from __future__ import annotations

from collections.abc import Callable

from nsbench.report.style import format_count, format_number
from nsbench.studies.finding import Effort, Finding
from nsbench.studies.multipliers.effectivity import measure_bars
from nsbench.studies.multipliers.equal_cost import KEPT, ZERO, best_division, spend
from nsbench.studies.multipliers.figures import settling_figure
from nsbench.studies.multipliers.settling import (
    TOLERANCE,
    fit_growth,
    follow_column,
    follow_events,
    follow_pile,
    last_right,
)
from nsbench.studies.multipliers.tables import (
    bars_table,
    columns_table,
    costs_table,
    events_table,
    piles_table,
)
from nsbench.studies.parts import Part
from nsbench.studies.registry import find_study

COLUMNS = ((5, 10, 20), (5, 10, 20, 40, 80))
COLUMN_METHODS = (
    "pbd",
    "pbd[order=reverse]",
    "pbd[order=random,seed=1]",
    "pbd[sweeps=4]",
    "warm pbd",
    "warm pbd[sweeps=4]",
    "catching_up",
)
PILES = ((3, 6, 12), (3, 6, 12, 24))  # rows
PILE_METHODS = ("pbd", "pbd[order=reverse]", "pbd[sweeps=4]", "warm pbd", "warm pbd[sweeps=4]")
EVENT_CASES = (
    "tide",
    "wedge[psi=60.0,swell=0.5]",
    "rods_wall[n=5,swell=0.5]",
    "chain[growth=1.0]",
)
EVENT_METHODS = ("pbd", "pbd[order=reverse]", "pbd[sweeps=4]", "warm pbd", "catching_up")
DIVISORS = (64, 256)  # steps in a sample interval: a number of steps must not depend on them
COST_CASES = (
    ("rods_wall[n=10]", "stack[n=10]", "discs[n=10,seed=0]", "hex[n=7]", "chain[growth=1.0]"),
    ("rods_wall[n=30]", "stack[n=20]", "discs[n=30,seed=0]", "hex[n=19]", "epithelium"),
)
SWEEPS_PER_SAMPLE = (64, 1024)
BAR_CASES = (
    ("tide", "rods[n=5]", "wedge", "box_turning", "three_discs", "discs[n=10,seed=0]", "hex"),
    ("play", "moving_floor", "duplicate", "discs[n=30,seed=0]", "chain", "stack", "obstacle"),
    ("bean", "wheel", "two_discs", "kissing", "epithelium", "teaser"),
)
BAR_METHODS = ("pbd", "catching_up")
BAR_DIVISORS = ((2, 8), (2, 8, 32))
PROVEN = "bound"
REFUTATION = (
    "A proven bound below an error at some sample; a multiplier of a column that settles in a "
    "number of steps that does not grow like the square of its height under single sweeps, from "
    "zero or from kept multipliers."
)


def conduct(effort: Effort) -> Finding:
    """Conduct the study. Raises ArithmeticError where a proven bound is below an error."""
    columns = _settle(effort, "column", follow_column, COLUMN_METHODS, COLUMNS[effort.full])
    piles = _settle(effort, "pile", follow_pile, PILE_METHODS, PILES[effort.full])
    events = _settle_events(effort)
    costs = _divide_costs(effort)
    bars = _measure_bars(effort)
    for row in bars:
        if row["kind"] == PROVEN and row["least"] < 1.0:
            raise ArithmeticError(f"a bound below an error: {row}")
    growth = _growths(columns)
    pile_growth = _growths(piles)
    return Finding(
        name="multipliers",
        question=find_study("multipliers").question,
        short=_short_answer(columns, growth),
        answer=_answer(columns, growth, events, costs),
        evidence=(
            *_evidence(growth, events, costs, bars),
            *_warm_evidence(columns, growth, costs),
            _pile_evidence(piles, pile_growth),
        ),
        refutation=REFUTATION,
        command=f"nsbench study multipliers{' --full' * effort.full}",
        tables=(
            columns_table(columns, growth),
            piles_table(piles, pile_growth),
            events_table(events),
            costs_table(costs),
            bars_table(bars),
        ),
        figures=(settling_figure(columns, piles, growth, _by_case(costs)),),
        data={
            "columns": columns,
            "growth": growth,
            "piles": piles,
            "pile_growth": pile_growth,
            "events": events,
            "equal_cost": costs,
            "bars": bars,
        },
    )


def _settle(effort: Effort, scene: str, follow: Callable, methods: tuple, sizes: tuple) -> list:
    """Follow a scene of each size under each method until its multipliers are right."""
    return effort.parts(
        [
            Part(
                f"{scene} {size} {method}",
                f"multipliers: a {scene} of size {size}, {method}",
                follow,
                (size, method),
            )
            for method in methods
            for size in sizes
        ]
    )


def _growths(found: list[dict]) -> dict[str, dict]:
    """Fit the growth of steps with the size for each method with three known ones or more."""
    groups: dict[str, list[dict]] = {}
    for f in found:
        groups.setdefault(f["method"], []).append(f)
    return {m: fit_growth(g) for m, g in groups.items() if sum(map(bool, map(last_right, g))) > 2}


def _settle_events(effort: Effort) -> list[dict]:
    found = effort.parts(
        [
            Part(
                f"events {key} {method} {divisor}",
                f"multipliers: after the events of {key}, {method}, spacing / {divisor}",
                follow_events,
                (key, method, divisor),
            )
            for key in EVENT_CASES
            for method in EVENT_METHODS
            for divisor in DIVISORS
        ]
    )
    return [row for rows in found for row in rows]


def _divide_costs(effort: Effort) -> list[dict]:
    cost = effort.choose(*SWEEPS_PER_SAMPLE)
    found = effort.parts(
        [
            Part(f"cost {key} {cost}", f"multipliers: steps or sweeps on {key}", spend, (key, cost))
            for key in COST_CASES[effort.full]
        ]
    )
    return [row for rows in found for row in rows]


def _measure_bars(effort: Effort) -> list[dict]:
    cases = BAR_CASES[0]
    if effort.full:
        cases = tuple(key for group in BAR_CASES for key in group)
    divisors = BAR_DIVISORS[effort.full]
    found = effort.parts(
        [
            Part(
                f"bars {key} {method} {divisors}",
                f"multipliers: error bars of {key}, {method}",
                measure_bars,
                (key, method, divisors),
            )
            for key in cases
            for method in BAR_METHODS
        ]
    )
    return [row for rows in found for row in rows]


def _short_answer(columns, growth) -> str:
    own = growth["pbd"]
    largest = max((c for c in columns if c["method"] == "pbd"), key=lambda c: c["n"])
    return (
        f"{_span(own['over_square'])} n^2 steps of one sweep in a column of n discs (the power "
        f"fitted is {own['power']:.3f}, up to n = {largest['n']})."
    )


def _answer(columns, growth, events, costs) -> str:
    single = growth["pbd"]
    plain = [m for m in growth if m.startswith("pbd") and "sweeps" not in m]
    squares = [v for m in plain for v in growth[m]["over_square"]]
    qp = [c for c in columns if c["method"] == "catching_up"]
    at_once = max(c["steps"][-1] or 0 for c in qp)
    more = growth.get("pbd[sweeps=4]")
    late = [e for e in events if e["method"] == "pbd" and e["steps"] is not None]
    slow = max(late, key=lambda e: e["steps"])
    wins = sum(best_division(g, "state")["sweeps"] == 1 for g in _by_case(costs))
    ratios = [
        best_division(g, "state", KEPT)["state"] / best_division(g, "state")["state"]
        for g in _by_case(costs)
    ]
    interval = f"[{single['low']:.3f}, {single['high']:.3f}]"
    return (
        f"Under one sweep per step the load of a column of n discs is right to "
        f"{100 * TOLERANCE:.0f} % at the floor after {_span(squares)} n^2 steps "
        f"(power {single['power']:.3f} {interval}) in {len(plain)} orders, under four sweeps "
        f"after {_span(more['over_square'])} n^2, under catching-up after "
        f"{at_once} steps; after an event of the other cases it takes up to {slow['steps']} steps "
        f"({slow['case']}); at equal cost one sweep with short steps has the smallest state error "
        f"on {wins} of {len(_by_case(costs))} cases without warm starts. With them the floor is "
        f"right after {_span(growth['warm pbd']['over_square'])} n^2 steps, and the state error at "
        f"equal cost is {_span(ratios)} of that of the best division without them."
    )


def _sweeps(row: dict) -> str:
    return format_count(row["sweeps"], "sweep")


def _span(values: list[float]) -> str:
    ends = [format_number(f(values), 3) for f in (min, max)]
    return " to ".join(dict.fromkeys(ends))


def _by_case(costs: list[dict]) -> list[list[dict]]:
    groups: dict[str, list[dict]] = {}
    for row in costs:
        groups.setdefault(row["case"], []).append(row)
    return list(groups.values())


def _evidence(growth, events, costs, bars) -> tuple[str, ...]:
    reach = growth["pbd"]["over_square"][-1] ** -0.5
    gains = []
    for group in _by_case(costs):
        best = best_division(group, "state")
        gain = format_number(_plain(group)["state"] / best["state"], 2)
        gains.append(f"{best['case']} {_sweeps(best)}, {best['order']} ({gain})")
    said = []
    for kind in (PROVEN, "estimate"):
        own = [r for r in bars if r["kind"] == kind]
        if own:
            state = _span([r["state"] for r in own])
            low = sum(r["least"] < 1.0 for r in own)
            said.append(f"{kind}s {state} over {len(own)} runs, {low} below an error at a sample")
    return (
        f"After s single-sweep steps about {format_number(reach, 2)} sqrt(s) discs have the right "
        f"load: information spreads like heat, not like a wave.",
        f"Smallest state error at equal cost, with the gain over one sorted sweep: "
        f"{'; '.join(gains)}.",
        f"Effectivity of error bars of the state: {'; '.join(said)}.",
        f"Numbers of steps after an event differ by at most {_largest_change(events)} between "
        f"h = spacing / {DIVISORS[0]} and / {DIVISORS[-1]}: it is steps that count, not time.",
    )


def _plain(group: list[dict]) -> dict:
    """Return the row of one sorted sweep from zero."""
    return next(
        r for r in group if r["start"] == ZERO and r["sweeps"] == 1 and r["order"] == "sorted"
    )


def _warm_evidence(columns, growth, costs) -> tuple[str, ...]:
    gains = []
    for group in _by_case(costs):
        plain = _plain(group)
        best = best_division(group, "state")
        warm = best_division(group, "state", KEPT)
        reaction = best_division(group, "reaction", KEPT)["reaction"]
        numbers = (
            plain["state"] / warm["state"],
            best["state"] / warm["state"],
            plain["reaction"] / reaction,
        )
        one, any_, push = (format_number(v, 2) for v in numbers)
        gains.append(f"{warm['case']} {one}, {any_}, {push} ({_sweeps(warm)})")
    costs_of = {
        "one sweep": growth["pbd"]["over_square"],
        "a kept start and one sweep": [2.0 * v for v in growth["warm pbd"]["over_square"]],
    }
    said = ", ".join(f"{_span(v)} n^2 under {name}" for name, v in costs_of.items())
    first = [c for c in columns if c["method"] == "warm pbd" and c["arrived"]]
    arrivals = [c["arrived"] / c["n"] for c in first]
    peaks = [c["peak"] for c in first]
    return (
        f"Under one sweep with warm starts the load of a column first reaches the floor after "
        f"{_span(arrivals)} n steps and rises there to {_span(peaks)} times its value. In sweeps, "
        f"of which a kept start counts as one, the floor is right after {said}.",
        f"Gain of warm starts at equal cost over one sorted sweep and over the best division "
        f"without them, in the state, and over one sorted sweep in the reaction: "
        f"{'; '.join(gains)}.",
    )


def _pile_evidence(piles, growth) -> str:
    said = []
    for method in (m for m in PILE_METHODS if m in growth):
        own = [p for p in piles if p["method"] == method]
        over = _span(growth[method]["over_square"])
        power = format_number(growth[method]["power"], 3)
        first = own[-1]["arrived"]
        said.append(f"{method} {over} n^2 (power {power}; first at the floor after {first})")
    return (
        f"Reactions in a pile of n rows are right after {'; '.join(said)}: the counts in brackets "
        f"are those of {piles[-1]['n']} rows."
    )


def _largest_change(events: list[dict]) -> int:
    """Return by how much the steps after one event differ between the step sizes."""
    groups: dict[tuple, list[int]] = {}
    for e in events:
        if e["steps"] is not None:
            groups.setdefault((e["case"], e["method"], e["event"]), []).append(e["steps"])
    return max((max(g) - min(g) for g in groups.values()), default=0)
