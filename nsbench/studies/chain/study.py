"""The study `chain`: reach of a violation by packing and order; PBD with large steps."""

from __future__ import annotations

from dataclasses import asdict

import numpy as np

from nsbench.case import get_case
from nsbench.report.style import format_number
from nsbench.studies.chain.figures import draw_decay, draw_projections
from nsbench.studies.chain.large_steps import all_pairs, count_sweeps, follow_step
from nsbench.studies.chain.travel import (
    THRESHOLD,
    bound_reach,
    corrections_by_distance,
    measure_travel,
)
from nsbench.studies.packings.contact_graphs import ContactGraph, chain, grow, hexagon
from nsbench.studies.packings.contact_orders import named_orders
from nsbench.studies.finding import Effort, EvidenceFigure, EvidenceTable, Finding
from nsbench.studies.parts import Part
from nsbench.studies.registry import find_study

SEED = 28
RANDOM_ORDERS = (5, 101)  # per packing: small form, full form
PACKING_DISCS = (30, 200)  # of the random packing
RINGS = (5, 8)  # of the hexagonal patch
STEPS = (0.5, 0.2, 0.05)  # h of a drift of rate 1: large for PBD
DRAWN_STEP = 0.3
REFUTATION = (
    "A packing and an order in which the reach exceeds the proven bound, or grows with the number "
    "of discs."
)


def conduct(effort: Effort) -> Finding:
    """Conduct the study. Raises ArithmeticError where a reach exceeds its proven bound."""
    graphs = _packings(effort)
    draws = effort.choose(*RANDOM_ORDERS)
    *travels, sweeps = effort.parts(
        [
            *(
                Part(
                    f"travel {graph.name} {effort.full}",
                    f"chain reactions: {graph.name}",
                    _measure,
                    (graph, draws),
                )
                for graph in graphs
            ),
            Part("sweeps", "chain reactions: one large step", _count_all_sweeps),
        ]
    )
    for entry in travels:
        if max(o["reach"] for o in entry["orders"]) > entry["bound"]:
            raise ArithmeticError(f"{entry['name']}: a reach exceeds its bound {entry['bound']}")
    return Finding(
        name="chain",
        question=find_study("chain").question,
        short=_short_answer(travels),
        answer=_answer(travels),
        evidence=_evidence(travels, sweeps),
        refutation=REFUTATION,
        command=f"nsbench study chain{' --full' * effort.full}",
        tables=(_travel_table(travels), _sweeps_table(sweeps)),
        figures=_figures(graphs),
        data={"packings": travels, "large_steps": sweeps, "seed": SEED},
    )


def _packings(effort: Effort) -> list[ContactGraph]:
    discs = effort.choose(*PACKING_DISCS)
    return [
        chain(12),
        chain(effort.choose(48, 200)),
        hexagon(1),
        hexagon(effort.choose(*RINGS)),
        grow(discs, SEED, loops=0.0, name=f"tree{discs}"),
        grow(discs, SEED, loops=0.9, name=f"kissing{discs}"),
    ]


def _measure(graph: ContactGraph, draws: int) -> dict:
    """Measure all orders of one packing; of `draws` random ones the worst reach and mean values."""
    orders = [
        {"order": name, **asdict(measure_travel(graph, order))}
        for name, order in named_orders(graph).items()
    ]
    reverse = named_orders(graph)["along the packing"][::-1].copy()
    orders.insert(1, {"order": "along, reversed", **asdict(measure_travel(graph, reverse))})
    rng = np.random.default_rng([SEED, len(graph.pairs)])
    drawn = [
        asdict(measure_travel(graph, rng.permutation(len(graph.pairs))))
        for _ in range(draws)
    ]
    worst = {key: max(d[key] for d in drawn) for key in ("reach", "left", "path")}
    means = {key: float(np.mean([d[key] for d in drawn])) for key in ("mean_reach", "moved")}
    orders.append({"order": f"random ({len(drawn)})", **worst, **means})
    return {
        "name": graph.name,
        "n": len(graph.centres),
        "contacts": len(graph.pairs),
        "bound": bound_reach(graph),
        "orders": orders,
    }


def _count_all_sweeps() -> list[dict]:
    """Count sweeps of exact projections after one large step, by packing, order and step."""
    out = []
    for graph in (chain(3), chain(12), hexagon(1), hexagon(2)):
        x = graph.centres - graph.centres.mean(axis=0)
        pairs = all_pairs(len(x))
        # no reverse order: a symmetry of these packings maps it onto the order itself
        for h in STEPS:
            shuffled = np.random.default_rng(SEED).permutation(pairs).tolist()
            for name, order in (("forward", pairs), ("random", shuffled)):
                left, sweeps = count_sweeps(x, h, order, 2.0)
                out.append(
                    {"name": graph.name, "h": h, "order": name, "left": left, "sweeps": sweeps}
                )
    return out


def _short_answer(travels: list[dict]) -> str:
    furthest = max(travels, key=lambda t: max(o["reach"] for o in t["orders"]))
    reach = max(o["reach"] for o in furthest["orders"])
    return (
        f"Up to {reach} contacts in the worst order ({furthest['name']}); no packing exceeds "
        f"its proven bound, which is {furthest['bound']} there."
    )


def _answer(travels: list[dict]) -> str:
    patch = travels[3]
    reaches = {o["order"]: o["reach"] for o in patch["orders"]}
    far = max(reaches, key=reaches.get)
    near = min(reaches, key=reaches.get)
    row = travels[1]
    along = max(o["reach"] for o in row["orders"])
    return (
        f"Not far, and never further than a bound free of the number of discs: corrections above "
        f"{THRESHOLD:g} of the violation reach at most {reaches[far]} contacts in {patch['name']} "
        f"({far}), {reaches[near]} in the best order ({near}), and {along} in {row['name']}, where "
        f"each contact passes on half."
    )


def _evidence(travels, sweeps) -> tuple[str, ...]:
    short = travels[0]
    long = travels[1]
    same = max(o["reach"] for o in short["orders"])
    other = max(o["reach"] for o in long["orders"])
    worst = max(sweeps, key=lambda s: s["sweeps"])
    return (
        f"The longest reach is {same} in {short['name']} and {other} in {long['name']}: once the "
        "chain is longer than that, it does not grow with the number of discs.",
        "The reach is at most the longest increasing path less one, and the violation decays along "
        "it: in a row by 1/2 at every contact, in a packing by 1/4 to 1/2 along each branch.",
        f"Exact projections after one large step need up to {worst['sweeps']} sweeps "
        f"({worst['name']}, h = {format_number(worst['h'])}, {worst['order']}) until no overlap "
        "exceeds 1e-6 diameters.",
    )


def _travel_table(travels: list[dict]) -> EvidenceTable:
    rows = [
        (
            t["name"],
            t["contacts"],
            o["order"],
            o["reach"],
            o["mean_reach"],
            o["moved"],
            o["left"],
            o["path"],
            t["bound"],
        )
        for t in travels
        for o in t["orders"]
    ]
    return EvidenceTable(
        "travel",
        "One violation in one sweep",
        (
            "packing",
            "contacts",
            "order",
            "reach",
            "mean reach",
            "contacts moved",
            "violation left",
            "longest increasing path",
            "bound of the reach",
        ),
        tuple(rows),
        f"Each contact in turn is violated by 1, all others are closed. Reach: distance in the "
        f"dual graph of the furthest correction of at least {THRESHOLD:g}; the largest over the "
        "violated contact, and its mean. Random orders: the largest reach, path and violation of "
        "all, means of the rest.",
    )


def _sweeps_table(sweeps: list[dict]) -> EvidenceTable:
    return EvidenceTable(
        "sweeps",
        "Exact projections after one large step",
        ("packing", "h", "order", "overlap after one sweep", "sweeps"),
        tuple((s["name"], s["h"], s["order"], s["left"], s["sweeps"]) for s in sweeps),
        "Touching discs move by -h x, then pairs are projected in turn. Overlap: largest after one "
        "sweep over largest before; sweeps: until no overlap exceeds 1e-6 diameters.",
    )


def _figures(graphs: list[ContactGraph]) -> tuple[EvidenceFigure, ...]:
    x = get_case("three_discs", overlap="keep").x0.reshape(-1, 2)
    pairs = all_pairs(len(x))
    rows = [
        ("order 1-2, 1-3, 2-3", follow_step(x, DRAWN_STEP, pairs, 2.0)),
        ("order 2-3, 1-3, 1-2", follow_step(x, DRAWN_STEP, pairs[::-1], 2.0)),
    ]
    panels = []
    for graph in graphs[1:4:2]:
        curves = {
            name: corrections_by_distance(graph, order)
            for name, order in named_orders(graph).items()
        }
        panels.append((graph.name, curves))
    return (
        EvidenceFigure(
            "projections",
            "One step of PBD with three overlapping discs, projection by projection, in two "
            "orders; an orange line joins discs that overlap, numbers are the overlaps found.",
            draw_projections(rows, 1.0),
        ),
        EvidenceFigure(
            "decay",
            "Largest correction in one sweep over the distance from the one violated contact, "
            "whichever that is.",
            draw_decay(panels),
        ),
    )
