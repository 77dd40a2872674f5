"""The study `multipliers`: settling, sweeps against steps at equal cost, and error bars."""

from __future__ import annotations

from nsbench.report.style import format_number
from nsbench.studies.curves import Curve, Panel, draw_panels
from nsbench.studies.finding import Effort, EvidenceFigure, EvidenceTable, Finding
from nsbench.studies.multipliers.effectivity import measure_bars
from nsbench.studies.multipliers.equal_cost import SWEEPS, best_division, spend
from nsbench.studies.multipliers.settling import (
    TOLERANCE,
    fit_growth,
    follow_column,
    follow_events,
)
from nsbench.studies.parts import Part
from nsbench.studies.registry import find_study

COLUMNS = ((5, 10, 20), (5, 10, 20, 40, 80))
COLUMN_METHODS = (
    "pbd",
    "pbd[order=reverse]",
    "pbd[order=random,seed=1]",
    "pbd[sweeps=4]",
    "catching_up",
)
EVENT_CASES = (
    "tide",
    "wedge[psi=60.0,swell=0.5]",
    "rods_wall[n=5,swell=0.5]",
    "chain[growth=1.0]",
)
EVENT_METHODS = ("pbd", "pbd[order=reverse]", "pbd[sweeps=4]", "catching_up")
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
    "number of steps that does not grow like the square of its height under single sweeps."
)


def conduct(effort: Effort) -> Finding:
    """Conduct the study. Raises ArithmeticError where a proven bound is below an error."""
    columns = _settle_columns(effort)
    events = _settle_events(effort)
    costs = _divide_costs(effort)
    bars = _measure_bars(effort)
    for row in bars:
        if row["kind"] == PROVEN and row["least"] < 1.0:
            raise ArithmeticError(f"a bound below an error: {row}")
    growth = {
        m: fit_growth([c for c in columns if c["method"] == m])
        for m in COLUMN_METHODS
        if sum(bool(c["steps"][-1]) for c in columns if c["method"] == m) > 2
    }
    return Finding(
        name="multipliers",
        question=find_study("multipliers").question,
        answer=_answer(columns, growth, events, costs),
        evidence=_evidence(growth, events, costs, bars),
        refutation=REFUTATION,
        command=f"nsbench study multipliers{' --full' * effort.full}",
        tables=(
            _columns_table(columns, growth),
            _events_table(events),
            _costs_table(costs),
            _bars_table(bars),
        ),
        figures=_figures(columns, costs),
        data={
            "columns": columns,
            "growth": growth,
            "events": events,
            "equal_cost": costs,
            "bars": bars,
        },
    )


def _settle_columns(effort: Effort) -> list[dict]:
    return effort.parts(
        [
            Part(
                f"column {n} {method}",
                f"multipliers: a column of {n} discs, {method}",
                follow_column,
                (n, method),
            )
            for method in COLUMN_METHODS
            for n in COLUMNS[effort.full]
        ]
    )


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
    interval = f"[{single['low']:.3f}, {single['high']:.3f}]"
    return (
        f"Under one sweep per step the load of a column of n discs is right to "
        f"{100 * TOLERANCE:.0f} % at the floor after {_span(squares)} n^2 steps "
        f"(power {single['power']:.3f} {interval}) in {len(plain)} orders, under four sweeps "
        f"after {_span(more['over_square'])} n^2, under catching-up after "
        f"{at_once} steps; after an event of the other cases it takes up to {slow['steps']} steps "
        f"({slow['case']}); at equal cost one sweep with short steps has the smallest state error "
        f"on {wins} of {len(_by_case(costs))} cases."
    )


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
        plain = next(r for r in group if r["sweeps"] == 1 and r["order"] == "sorted")
        gain = format_number(plain["state"] / best["state"], 2)
        gains.append(f"{best['case']} {best['sweeps']} sweeps, {best['order']} ({gain})")
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


def _largest_change(events: list[dict]) -> int:
    """Return by how much the steps after one event differ between the step sizes."""
    groups: dict[tuple, list[int]] = {}
    for e in events:
        if e["steps"] is not None:
            groups.setdefault((e["case"], e["method"], e["event"]), []).append(e["steps"])
    return max((max(g) - min(g) for g in groups.values()), default=0)


def _columns_table(columns, growth) -> EvidenceTable:
    rows = []
    for c in columns:
        floor = c["steps"][-1]
        middle = c["steps"][len(c["steps"]) // 2]
        found = growth.get(c["method"], {})
        rows.append(
            (
                c["n"],
                c["method"],
                c["steps"][0],
                middle,
                floor,
                floor / c["n"] ** 2 if floor is not None else None,
                found.get("power"),
            )
        )
    return EvidenceTable(
        "columns",
        "Steps until the multipliers of a column at rest are right",
        (
            "discs",
            "method",
            "topmost contact",
            "middle contact",
            "floor",
            "floor over n^2",
            "power of n",
        ),
        tuple(rows),
        f"Right: within {100 * TOLERANCE:.0f} % of its own load from then on. All discs touch at "
        "the start; gravity sets in at once. 0: right in the first step.",
    )


def _events_table(events) -> EvidenceTable:
    return EvidenceTable(
        "events",
        "Steps after an event until all multipliers are right",
        ("case", "method", "h", "event at t", "steps", "steps to the next event"),
        tuple(
            (e["case"], e["method"], e["h"], e["event"], e["steps"], e["available"])
            for e in events
        ),
        f"Right: within {100 * TOLERANCE:.0f} % of the largest multiplier until the next event. "
        "None: not before it.",
    )


def _costs_table(costs) -> EvidenceTable:
    return EvidenceTable(
        "equal-cost",
        "Steps or sweeps at equal cost",
        ("case", "order", "sweeps", "h", "projections", "state error", "reaction error"),
        tuple(
            (
                r["case"],
                r["order"],
                r["sweeps"],
                r["h"],
                r.get("projections"),
                r["state"],
                r["reaction"],
            )
            for r in costs
        ),
        "The product of steps and sweeps is the same in all rows of a case; one permutation stands "
        "for the random orders.",
    )


def _bars_table(bars) -> EvidenceTable:
    return EvidenceTable(
        "effectivity",
        "Effectivity of error bars",
        ("case", "method", "h", "kind", "state", "reaction", "least ratio at a sample"),
        tuple(
            (r["case"], r["method"], r["h"], r["kind"], r["state"], r["reaction"], r["least"])
            for r in bars
        ),
        "Largest error bar over the largest error. Bounds are proven, estimates are not. Runs "
        "without an error to compare with are left out.",
    )


def _figures(columns, costs) -> tuple[EvidenceFigure, ...]:
    curves = []
    for method in COLUMN_METHODS:
        own = [c for c in columns if c["method"] == method]
        curves.append(Curve(method, [c["n"] for c in own], [c["steps"][-1] for c in own]))
    sizes = [c["n"] for c in columns if c["method"] == "pbd"]
    curves.append(Curve("1.78 n^2", sizes, [1.78 * n**2 for n in sizes], guide=True))
    panels = [Panel("column of discs", tuple(curves), "discs", "steps until the floor is right")]
    for group in _by_case(costs):
        orders = dict.fromkeys(r["order"] for r in group)
        panels.append(
            Panel(
                group[0]["case"],
                tuple(
                    Curve(o, list(SWEEPS), [r["state"] for r in group if r["order"] == o])
                    for o in orders
                ),
                "sweeps per step, at equal cost",
                "largest state error",
            )
        )
    return (
        EvidenceFigure(
            "settling",
            "Steps until the load of a column has reached its floor; state error over the number "
            "of sweeps when steps are as many times longer.",
            draw_panels(panels, columns=3),
        ),
    )
