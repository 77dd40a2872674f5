"""Tables of the study `lemma` from its numbers, and the choice of its figures."""

from __future__ import annotations

import numpy as np

from nsbench.studies.finding import EvidenceFigure, EvidenceTable
from nsbench.studies.lemma.figures import (
    NumberedGraph,
    draw_constants,
    draw_distribution,
    draw_dual_graphs,
)
from nsbench.studies.lemma.random_packings import (
    band_width,
    quantile_interval,
    rank_correlations,
    tail_share,
)
from nsbench.studies.lemma.rare_constants import RARE_THRESHOLDS
from nsbench.studies.packings.contact_graphs import ContactGraph, chain, hexagon

QUANTILES = (0.1, 0.5, 0.9, 0.99)
THRESHOLDS = (1.0, 1.5, 2.0, 2.5)
MEANINGS = {  # of the inequalities; proofs in docs/studies.md
    "energy": "|c|^2 + |N^T c|^2 = -2 c . g",
    "corrections": "|c| <= 2 |v|",
    "reopened": "v'_k <= sum of a^-_kl c_l over later l",
    "violations": "|v'| <= 2 kappa |v|",
    "column sums": "|v'|_1 <= kappa |c|_1",
    "locality": "|W c| <= 2 |W v| / (1 - K (e^mu - 1))",
    "body weights": "|W c| <= 2 |W v| / (1 - K e^mu tanh mu), a second derivation",
    "difference": "the same for the difference of two sweeps",
    "largest violation": "v'_k against the bound of C at contact k",
    "sum": "|c|_1 against the bound of C'",
    "ellipsoid": "d . M d <= W v . d",
}


def constants_table(entries: list[dict]) -> EvidenceTable:
    """Tabulate the constants of all packings."""
    fields = (
        "name",
        "n",
        "contacts",
        "exact",
        "search",
        "bound",
        "exact_of_order",
        "sum_search",
        "sum_bound",
        "max_degree",
        "longest_increasing_path",
    )
    return EvidenceTable(
        "constants",
        "Constants of one sweep",
        (
            "packing",
            "discs",
            "contacts",
            "C exact",
            "C search",
            "C bound",
            "C of that order",
            "C' search",
            "C' bound",
            "most contacts of a disc",
            "longest increasing path",
        ),
        tuple(tuple(e[f] for f in fields) for e in entries),
        "C: largest violation left over the largest before; C': sum over sum. Exact: over all "
        "gaps and orders, by mixed-integer programming with proof; none where that is out of "
        "reach. Search: the worst order and gaps found, a lower bound; its order has the exact "
        "constant and the longest increasing path given beside it. Bound: proven for any order.",
    )


def theory_table(theory: dict) -> EvidenceTable:
    """Tabulate the inequalities that were checked in exact arithmetic."""
    counts = theory["instances"]
    rows = [
        (name, MEANINGS[name], counts["checked"], failed)
        for name, failed in counts.items()
        if name != "checked"
    ]
    return EvidenceTable(
        "theory",
        "Inequalities in exact rational arithmetic",
        ("inequality", "formula", "graphs with orders", "violated"),
        tuple(rows),
        "Two exact methods on tiny packings: "
        + "; ".join(
            f"{e['name']} {e['milp']:.6f} and {e['enumeration']:.6f}"
            for e in theory["two_exact_methods"]
        )
        + ".",
    )


def quantile_table(values: np.ndarray) -> EvidenceTable:
    """Tabulate quantiles and tail probabilities of the constant of random packings."""
    rows: list[tuple] = []
    for level in QUANTILES:
        value, low, high = quantile_interval(values, level)
        rows.append((f"quantile {level:g}", value, low, high))
    for threshold in THRESHOLDS:
        share, (low, high) = tail_share(values, threshold)
        rows.append((f"probability of C > {threshold:g}", share, low, high))
    return EvidenceTable(
        "likelihood",
        "Random packings of 12 discs in random orders",
        ("of C", "value", "95 % from", "to"),
        tuple(rows),
        f"{len(values)} packings, one order each; C of that order over all gaps.",
    )


def rare_table(rare: list[dict], tail: dict, samples: int) -> EvidenceTable:
    """Tabulate the probabilities of rare constants by plain sampling and by splitting."""
    rows = [
        (f"{r['threshold']:g}", words, *r[method])
        for r in rare
        if r["threshold"] in RARE_THRESHOLDS
        for method, words in (("plain", "plain sampling"), ("splitting", "splitting"))
    ]
    return EvidenceTable(
        "rare",
        "Rare constants of random packings of 12 discs",
        ("c", "method", "probability of C > c", "95 % from", "to"),
        tuple(rows),
        f"Plain sampling: {samples} packings, intervals of Clopper and Pearson. Multilevel "
        f"splitting: {len(tail['estimates'])} independent runs of {tail['points']} packings, "
        f"{tail['steps']} Markov steps of each at every one of {len(tail['levels'])} levels that "
        "a further run placed; intervals of Student's t, approximate where runs scatter much. C of "
        "an order is the value found by coordinate ascent, a lower bound: the probabilities are "
        "those of this value.",
    )


def correlation_table(rows: np.ndarray) -> EvidenceTable:
    """Tabulate the rank correlation of C with size, degree and path length."""
    return EvidenceTable(
        "correlations",
        "What a large constant goes with",
        ("quantity", "rank correlation with C"),
        tuple(rank_correlations(rows).items()),
        f"Spearman's coefficient over {len(rows)} random packings of 6 to 24 discs.",
    )


def orders_table(orders: list[dict]) -> EvidenceTable:
    """Tabulate the constants of named, random and best orders."""
    names = list(orders[0]["named"])
    rows = [
        (
            o["name"],
            *(o["named"][n] for n in names),
            o["random"],
            o["best"],
            o["best_exact"],
            o["evaluations_needed"],
        )
        for o in orders
    ]
    return EvidenceTable(
        "orders",
        "Constants by order",
        ("packing", *names, "random (median)", "best found", "exact", "evaluations"),
        tuple(rows),
        "Evaluations: orders tried until the constant was within 1 % of the best found; one takes "
        "a coordinate ascent over the gaps for every contact.",
    )


def geometry_table(geometries: list[dict], entries: list[dict]) -> EvidenceTable:
    """Tabulate the worst packings found, with the row of as many discs."""
    rows = {e["n"]: e["search"] for e in entries if e["name"].startswith("chain")}
    return EvidenceTable(
        "geometry",
        "The worst packing of equal discs found",
        ("discs", "contacts", "C exact", "C search", "C bound", "C of as many in a row"),
        tuple(
            (g["n"], g["contacts"], g["exact"], g["search"], g["bound"], rows.get(g["n"]))
            for g in geometries
        ),
        "Kissing graphs are grown and mutated disc by disc, each searched over orders and gaps.",
    )


def draw_figures(
    entries: list[dict], geometries: list[dict], values: np.ndarray, tail: np.ndarray
) -> tuple[EvidenceFigure, ...]:
    """Draw the dual graphs of worst cases, the constants over the size, and the distribution.

    values: C of random packings; tail: rows (c, P(C > c), low, high) by splitting.
    """
    by_name = {e["name"]: e for e in entries}
    panels = [
        NumberedGraph(
            f"{g.name}: C >= {by_name[g.name]['search']:.3f}",
            g,
            np.array(by_name[g.name]["worst_order"]),
            np.array(by_name[g.name]["worst_gaps"]),
            by_name[g.name]["worst_target"],
        )
        for g in (chain(8), hexagon(1), hexagon(2))
    ]
    bent = geometries[-1]
    centres = np.array(bent["centres"])
    panels.append(
        NumberedGraph(
            f"worst of {bent['n']} discs: C >= {bent['search']:.3f}",
            ContactGraph("worst", centres, np.ones(len(centres)), np.array(bent["pairs"])),
            np.array(bent["worst_order"]),
            np.array(bent["worst_gaps"]),
            bent["worst_target"],
        )
    )
    return (
        EvidenceFigure(
            "dual_graphs",
            "Dual graphs with the worst order found: contacts are numbered as they are projected, "
            "filled where violated before the sweep; the ringed one is left with the largest "
            "violation. Orange lines join contacts of one disc of which one opens the other.",
            draw_dual_graphs(panels),
        ),
        EvidenceFigure(
            "constants",
            "Exact constant, best value found and proven bound over the number of discs.",
            draw_constants(entries),
        ),
        EvidenceFigure(
            "distribution",
            "Random packings of 12 discs in random orders: left with a uniform 95 % band; right "
            "the tail, plain samples and multilevel splitting, each with 95 % intervals.",
            draw_distribution(values, band_width(len(values)), tail),
        ),
    )
