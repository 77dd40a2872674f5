"""The study `lemma`: theory checked, constants of listed packings, random packings, orders."""

from __future__ import annotations

import numpy as np

from nsbench.report.style import format_number
from nsbench.studies.finding import Effort, EvidenceTable, Finding
from nsbench.studies.lemma import random_packings
from nsbench.studies.lemma.exact_constant import enumerate_violation, exact_violation
from nsbench.studies.lemma.graph_constants import listed_graphs, measure_constants
from nsbench.studies.lemma.proven_bound import bound_equal_discs
from nsbench.studies.lemma.rare_constants import (
    RARE_THRESHOLDS,
    compare_with_plain,
    estimate_run,
    find_levels,
    summarise_tail,
)
from nsbench.studies.lemma.sweep_orders import find_best_order, median_of_random_orders
from nsbench.studies.lemma.tables import (
    constants_table,
    correlation_table,
    draw_figures,
    geometry_table,
    orders_table,
    quantile_table,
    rare_table,
    theory_table,
)
from nsbench.studies.lemma.theory_check import count_violations, largest_ratio
from nsbench.studies.lemma.worst_geometry import find_worst_geometry
from nsbench.studies.packings.contact_graphs import ContactGraph, chain, grow, hexagon, star
from nsbench.studies.packings.contact_orders import named_orders
from nsbench.studies.parts import Part
from nsbench.studies.registry import find_study

SEED = 27
EXACT_INSTANCES = (200, 20_000)  # of the check in rational arithmetic: small form, full form
CLIMBS = (12, 200)  # starts of the search for a counterexample
CLIMB_STEPS = 400
PACKINGS = (2_000, 100_000)  # random packings of the distribution
MIXED_PACKINGS = (400, 10_000)  # of many sizes, for the correlations
BLOCK = 500  # instances or packings of one part
RAREST = (1e-4, 1e-8)  # probability down to which the tail is followed by splitting
TAIL_RUNS = (5, 10)  # independent ones, beside that which places the levels
TAIL_POINTS = (100, 500)  # of one run
TAIL_STEPS = (5, 20)  # of every point at every level
COMPARED = (4, 200)  # packings whose ascent value is compared with the exact one
ANNEALING_STEPS = (20_000, 200_000)
ANNEALING_STARTS = (3, 8)
TARGET_SECONDS = (10.0, 600.0)  # limit of HiGHS for one target
GEOMETRY_DISCS = (5, 7, 9, 12)
GEOMETRY_TRIES = (60, 4_000)  # packings per number of discs
GEOMETRY_EXACT = (8, 16)  # contacts up to which the worst packing found is solved exactly
ORDER_STEPS = (100, 3_000)  # evaluations of the search for the best order
REFUTATION = (
    "An inequality that fails in exact arithmetic; a search value above an exact value or a bound; "
    "an exact value above a bound; two exact methods that differ."
)


def conduct(effort: Effort) -> Finding:
    """Conduct the study. Raises ArithmeticError where two of its values contradict each other."""
    theory = _check_theory(effort)
    entries = _measure_graphs(effort)
    samples, mixed, compared = _sample_packings(effort)
    tail = _estimate_tail(effort)
    rare = compare_with_plain(tail, samples[:, 0])
    orders = _compare_orders(effort)
    geometries = _search_geometry(effort)
    uniform = bound_equal_discs()
    _check_consistency(entries + geometries, theory, compared)
    tables: tuple[EvidenceTable, ...] = (
        constants_table(entries),
        theory_table(theory),
        quantile_table(samples[:, 0]),
        rare_table(rare, tail, len(samples)),
        correlation_table(mixed),
        orders_table(orders),
        geometry_table(geometries, entries),
    )
    return Finding(
        name="lemma",
        question=find_study("lemma").question,
        short=_short_answer(uniform),
        answer=_answer(entries, theory, uniform),
        evidence=(
            *_evidence(entries, theory, samples, compared, orders, geometries),
            *_rare_evidence(rare, tail),
        ),
        refutation=REFUTATION,
        command=f"nsbench study lemma{' --full' * effort.full}",
        tables=tables,
        figures=draw_figures(entries, geometries, samples[:, 0], summarise_tail(tail)),
        data={
            "graphs": entries,
            "seed": SEED,
            "uniform_bound": uniform,
            "theory": theory,
            "packings": {"samples": len(samples), "compared_with_exact": compared, "tail": tail},
            "orders": orders,
            "worst_geometries": geometries,
        },
    )


def _check_theory(effort: Effort) -> dict:
    """Count violated inequalities in exact arithmetic, and compare two exact methods."""
    instances = effort.choose(*EXACT_INSTANCES)
    climbs = effort.choose(*CLIMBS)
    *blocks, ratio, agreement = effort.parts(
        [
            *(
                Part(
                    f"theory {first} {last}",
                    f"theory: graphs {first} to {last} of {instances} in exact arithmetic",
                    count_violations,
                    (SEED, first, last),
                )
                for first, last in _blocks(instances)
            ),
            Part(
                f"ratio {climbs}",
                "theory: search for a counterexample",
                largest_ratio,
                (SEED, climbs, CLIMB_STEPS),
            ),
            Part("two exact methods", "theory: two exact methods", _compare_exact_methods),
        ]
    )
    total: dict[str, int] = {}
    for block in blocks:
        total = {name: total.get(name, 0) + count for name, count in block.items()}
    return {"instances": total, "largest_ratio": ratio, "two_exact_methods": agreement}


def _blocks(count: int) -> list[tuple[int, int]]:
    """Divide `count` instances into blocks: first one, and one beyond the last."""
    return [(first, min(first + BLOCK, count)) for first in range(0, count, BLOCK)]


def _compare_exact_methods() -> list[dict]:
    """Compare mixed-integer programming with enumeration on packings of two to four contacts."""
    tiny = (chain(3), chain(4), star(3, 1), grow(3, 0, 1.0, name="triangle"))
    out = []
    for graph in tiny:
        contacts = list(range(len(graph.pairs)))
        programme = exact_violation(graph.gram, graph.distances(), contacts, TARGET_SECONDS[0])
        enumerated = max(0.0, enumerate_violation(graph.gram))
        out.append({"name": graph.name, "milp": programme.value, "enumeration": enumerated})
    return out


def _measure_graphs(effort: Effort) -> list[dict]:
    arguments = (
        SEED,
        effort.choose(*ANNEALING_STARTS),
        effort.choose(*ANNEALING_STEPS),
        effort.choose(*TARGET_SECONDS),
        effort.full,
    )
    return effort.parts(
        [
            Part(
                f"graph {graph.name} {arguments}",
                f"constants: {graph.name}",
                measure_constants,
                (graph, *arguments),
            )
            for graph in listed_graphs(effort.full)
        ]
    )


def _sample_packings(effort: Effort) -> tuple[np.ndarray, np.ndarray, dict]:
    """Measure packings of 12 discs and mixed ones; compare some with the exact value."""
    compared = effort.choose(*COMPARED)
    groups = (
        ("typical", effort.choose(*PACKINGS), random_packings.TYPICAL_DISCS),
        ("mixed", effort.choose(*MIXED_PACKINGS), None),
    )
    blocks = [
        Part(
            f"packings {name} {first} {last}",
            f"random packings ({name}): {first} to {last} of {count}",
            random_packings.measure_block,
            (SEED, first, last, discs),
        )
        for name, count, discs in groups
        for first, last in _blocks(count)
    ]
    comparison = Part(
        f"compared {compared}",
        "random packings: comparison with exact values",
        random_packings.compare_with_exact,
        (SEED, compared),
    )
    found, *values = effort.parts([comparison, *blocks])
    rows = [row for value in values for row in value]
    typical = groups[0][1]
    return np.array(rows[:typical]), np.array(rows[typical:]), found


def _estimate_tail(effort: Effort) -> dict:
    """Estimate P(C > c) for rare c by runs of multilevel splitting, after one for the levels."""
    sizes = effort.choose(*TAIL_POINTS), effort.choose(*TAIL_STEPS)
    rarest = effort.choose(*RAREST)
    runs = effort.choose(*TAIL_RUNS)
    (levels,) = effort.parts(
        [Part(f"levels {sizes} {rarest}", "tail: levels", find_levels, (SEED, *sizes, rarest))]
    )
    thresholds = sorted({*levels, *RARE_THRESHOLDS})
    estimates = effort.parts(
        [
            Part(
                f"tail {run} {sizes} {rarest}",
                f"tail: run {run} of {runs}",
                estimate_run,
                (SEED, run, *sizes, levels, thresholds),
            )
            for run in range(1, runs + 1)
        ]
    )
    return {
        "points": sizes[0],
        "steps": sizes[1],
        "levels": levels,
        "thresholds": thresholds,
        "estimates": estimates,
    }


def _compare_orders(effort: Effort) -> list[dict]:
    """Measure named, random and best orders of four packings."""
    graphs: list[ContactGraph] = [chain(12), hexagon(1), grow(9, 0), star(3, 2)]
    graphs += [hexagon(2)] if effort.full else []
    limits = effort.choose(*ORDER_STEPS), effort.choose(*TARGET_SECONDS)
    return effort.parts(
        [
            Part(f"orders {g.name} {effort.full}", f"orders: {g.name}", _orders_of, (g, *limits))
            for g in graphs
        ]
    )


def _orders_of(graph: ContactGraph, steps: int, seconds: float) -> dict:
    from nsbench.studies.lemma.adversarial_search import search_fixed_order

    gram = graph.gram
    named = named_orders(graph)
    values = {name: search_fixed_order(gram, order) for name, order in named.items()}
    start = named[min(values, key=values.get)]
    best = find_best_order(gram, start, SEED, steps)
    contacts = list(range(len(gram)))
    exact = exact_violation(gram, graph.distances(), contacts, seconds, best.order)
    return {
        "name": graph.name,
        "named": values,
        "random": median_of_random_orders(gram, SEED),
        "best": best.value,
        "best_exact": exact.value if exact.proven else None,
        "best_order": [int(k) for k in best.order],
        "evaluations": best.evaluations,
        "evaluations_needed": best.evaluations_needed,
    }


def _search_geometry(effort: Effort) -> list[dict]:
    """Search for the packing with the largest constant, by number of discs."""
    arguments = tuple(
        effort.choose(*sizes) for sizes in (GEOMETRY_TRIES, TARGET_SECONDS, GEOMETRY_EXACT)
    )
    return effort.parts(
        [
            Part(
                f"geometry {discs} {arguments}",
                f"geometry: {discs} discs",
                find_worst_geometry,
                (discs, SEED, *arguments),
            )
            for discs in GEOMETRY_DISCS
        ]
    )


def _check_consistency(entries: list[dict], theory: dict, compared: dict) -> None:
    """Raise ArithmeticError where an inequality that must hold does not."""
    for e in entries:
        exact = e["exact"]
        if e["search"] > e["bound"] or e.get("sum_search", 0.0) > e.get("sum_bound", 0.0):
            raise ArithmeticError(f"a value found exceeds its bound: {_short(e)}")
        if exact is not None and not e["search"] <= exact <= e["bound"]:
            raise ArithmeticError(f"search, exact and bound are out of order: {_short(e)}")
    failed = {k: v for k, v in theory["instances"].items() if k != "checked" and v}
    if failed:
        raise ArithmeticError(f"inequalities that fail in exact arithmetic: {failed}")
    if compared["above"]:
        raise ArithmeticError(f"search above the exact value of an order: {compared}")


def _short(entry: dict) -> dict:
    """Values of an entry without its orders, gaps and centres."""
    return {k: v for k, v in entry.items() if not isinstance(v, list)}


def _short_answer(uniform: float) -> str:
    """Say yes with the bound: a study that violates an inequality has raised before."""
    return (
        f"Yes, for the linearised sweep: by at most {_round(uniform, np.ceil)} times the violation "
        "for equal discs in the plane."
    )


def _answer(entries: list[dict], theory: dict, uniform: float) -> str:
    row = max((e for e in entries if e["name"].startswith("chain")), key=lambda e: e["n"])
    patches = sorted((e for e in entries if e["name"].startswith("hex")), key=lambda e: e["n"])
    flower = patches[0]
    patch = patches[-1]
    return (
        "For the linearised sweep this is proven, and violated by none of "
        f"{theory['instances']['checked']} random graphs in exact arithmetic; the constant is "
        f"exactly {format_number(row['exact'], 5)} for {row['n']} discs in a row and "
        f"{format_number(flower['exact'], 5)} for a hexagon of {flower['n']}, between "
        f"{_round(patch['search'], np.floor)} and {_round(patch['bound'], np.ceil)} for a "
        f"hexagon of {patch['n']}, and at most {_round(uniform, np.ceil)} for equal discs in "
        "the plane, whatever their number."
    )


def _round(value: float, towards: np.ufunc) -> str:
    """Round to a tenth so that a bound stays one: down for values found, up for bounds."""
    return f"{towards(10.0 * value) / 10.0:g}"


def _evidence(entries, theory, samples, compared, orders, geometries) -> tuple[str, ...]:
    exact = [e for e in entries if e["exact"] is not None]
    found = sum(e["search"] >= e["exact"] * (1.0 - 1e-6) for e in exact)
    values = samples[:, 0]
    share, (low, high) = random_packings.tail_share(values, 2.0)
    worst = max(orders, key=lambda o: max(o["named"].values()) / o["best"])
    name = max(worst["named"], key=worst["named"].get)
    bent = geometries[-1]
    row = max((e for e in entries if e["name"].startswith("chain")), key=lambda e: e["n"])
    return (
        f"The search reaches the exact constant over all orders on {found} of {len(exact)} "
        "packings where mixed-integer programming proves it; bounds are "
        f"{format_number(min(e['bound'] / e['exact'] for e in exact), 3)} to "
        f"{format_number(max(e['bound'] / e['exact'] for e in exact), 3)} times the exact value.",
        f"The largest |c| / (2 |v|) that climbing over gaps, orders and directions found is "
        f"{format_number(theory['largest_ratio'], 3)}; 1 would be the limit.",
        f"Among {len(values)} random packings of 12 discs in random orders the median constant is "
        f"{format_number(float(np.median(values)), 3)}, the largest "
        f"{format_number(float(values.max()), 3)}; a constant above 2 has probability "
        f"{format_number(share, 3)} (95 %: {format_number(low, 3)} to "
        f"{format_number(high, 3)}).",
        f"On {compared['equal']} of {compared['equal'] + compared['below'] + compared['above']} "
        "of these packings the ascent was compared with the exact value of their order and "
        f"reached it; it fell short on {compared['below']}.",
        f"The order matters: on {worst['name']} the order {name} has "
        f"{format_number(max(worst['named'].values()) / worst['best'], 2)} times the constant of "
        "the best order found.",
        f"Geometry: the worst packing of {bent['n']} discs found has a constant of at least "
        f"{_round(bent['search'], np.floor)}, against {format_number(row['exact'], 3)} of "
        f"{row['n']} discs in a row.",
    )


def _rare_evidence(rare: list[dict], tail: dict) -> tuple[str, ...]:
    """Say how rare the largest constants are: of the last threshold whose interval excludes 0."""
    named = [r for r in rare if r["threshold"] in RARE_THRESHOLDS]
    resolved = [r for r in named if r["splitting"][1] > 0.0]
    if not resolved:
        return ()
    share, low, high = (format_number(v, 2) for v in resolved[-1]["splitting"])
    compared = [r["agree"] for r in rare if r["agree"] is not None]
    return (
        f"A constant above {resolved[-1]['threshold']:g} has probability {share} (95 %: {low} to "
        f"{high}, multilevel splitting, {len(tail['estimates'])} runs of {tail['points']} "
        f"packings); intervals of splitting and of plain sampling overlap at {sum(compared)} of "
        f"the {len(compared)} thresholds and levels that plain samples exceed.",
    )
