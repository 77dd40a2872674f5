"""The sweep constants of one packing: exact values, best values found, proven bounds.

One entry of `graphs` in DIR/studies/lemma.json is what `measure_constants` returns.
"""

from __future__ import annotations

from nsbench.studies.packings.contact_graphs import (
    ContactGraph,
    chain,
    close_packed,
    flower,
    grow,
    hexagon,
    star,
)
from nsbench.studies.lemma.adversarial_search import (
    distinct_contacts,
    search_sum,
    search_violation,
)
from nsbench.studies.lemma.exact_constant import exact_violation
from nsbench.studies.lemma.proven_bound import bound_sum, bound_violation
from nsbench.studies.packings.linear_sweep import longest_increasing_path

MAX_EXACT_CONTACTS = 14  # of which HiGHS solves all orders in seconds; 42 take more than an hour
MAX_FREE_CONTACTS = 25  # the same in the full form, where each contact may be of its own kind
MAX_CONTACTS_OF_ORDER = 42  # of which HiGHS solves one order in seconds
MAX_CONTACTS_OF_ORDER_FULL = 100  # in a minute
AGREEMENT = 1e-6  # relative tolerance of HiGHS


def listed_graphs(full: bool) -> list[ContactGraph]:
    """List the packings of the study: chains, hexagonal patches, trees, random ones, spheres."""
    graphs = [chain(n) for n in range(3, 13)]
    graphs += [hexagon(rings) for rings in range(1, 6)]
    graphs += [star(3, 2), star(5, 2), grow(8, 0, loops=0.0, name="tree8s0")]
    graphs += [grow(9, 0), flower(5), flower(12), grow(8, 0, spread=2.0, name="radii8s0")]
    graphs += [close_packed(13), grow(8, 0, dim=3, name="space8s0")]
    if full:
        graphs += [star(3, 1), star(5, 1), flower(7), flower(20)]
        graphs += [grow(n, seed) for n, seed in ((9, 1), (9, 2), (20, 0), (20, 1), (40, 0))]
        graphs += [grow(8, 1, spread=2.0, name="radii8s1")]
        graphs += [grow(30, seed, spread=3.0, name=f"radii30s{seed}") for seed in range(2)]
        graphs += [close_packed(43), close_packed(55), grow(30, 0, dim=3, name="space30s0")]
    return graphs


def measure_constants(
    graph: ContactGraph, seed: int, starts: int, steps: int, seconds: float, full: bool
) -> dict:
    """Compute all constants of one packing.

    starts, steps: of the search. seconds: limit of HiGHS for one target. `exact` is None where the
    packing has too many contacts for all orders, or where HiGHS did not finish; `exact_of_order` is
    the exact value of the worst order found.
    """
    gram = graph.gram
    distance = graph.distances()
    contacts = distinct_contacts(gram, distance)
    worst = search_violation(gram, distance, seed, starts, steps)
    worst_sum = search_sum(gram, distance, seed, starts, steps)
    of_order = None
    if len(gram) <= (MAX_CONTACTS_OF_ORDER_FULL if full else MAX_CONTACTS_OF_ORDER):
        of_order = _proven_value(gram, distance, [worst.target], seconds, worst)
    limit = MAX_FREE_CONTACTS if full else MAX_EXACT_CONTACTS
    exact = None
    if len(gram) <= limit:
        exact = _proven_value(gram, distance, contacts, seconds, worst, free=True)
    return {
        "name": graph.name,
        "n": len(graph.centres),
        "contacts": len(gram),
        "exact": exact,
        "search": worst.value,
        "bound": bound_violation(gram, distance, contacts),
        "sum_search": worst_sum.value,
        "sum_bound": bound_sum(gram, distance, contacts),
        "exact_of_order": of_order,
        "max_degree": graph.max_degree,
        "longest_increasing_path": longest_increasing_path(gram, worst.order),
        "worst_order": [int(k) for k in worst.order],
        "worst_gaps": [float(g) for g in worst.gaps],
        "worst_target": worst.target,
    }


def _proven_value(gram, distance, contacts, seconds, worst, free=False) -> float | None:
    """Exact value over all orders (free) or the worst order found; None if it is not proven.

    Both HiGHS and the search give values of sweeps; where they agree within the tolerance of HiGHS
    the larger one is returned.
    """
    found = exact_violation(gram, distance, contacts, seconds, None if free else worst.order)
    if not found.proven:
        return None
    agree = worst.value <= found.value * (1.0 + AGREEMENT)
    return max(found.value, worst.value) if agree else found.value
