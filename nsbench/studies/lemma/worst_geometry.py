"""Search over geometry: the kissing graph of n equal discs with the largest constant of a sweep.

A packing is grown with one seed per disc; a mutation changes one or two seeds, which moves these
discs and all that touch them, and is kept where the constant, searched over orders and gaps, does
not fall. Exact value and bound of the packing that is found stand beside it.
"""

from __future__ import annotations

import numpy as np

from nsbench.studies.lemma.adversarial_search import distinct_contacts, search_violation
from nsbench.studies.lemma.exact_constant import exact_violation
from nsbench.studies.lemma.proven_bound import bound_violation
from nsbench.studies.packings.contact_graphs import ContactGraph, grow_from

ANNEALING_STEPS = 4_000  # of the search within one packing
LONG_STEPS = 40_000  # of that of the packing found
LONG_STARTS = 3
RESTART_SHARE = 0.3  # of the mutations: new packings, before any is improved
AGREEMENT = 1e-6  # relative tolerance of HiGHS
SEED_RANGE = 1 << 31


def find_worst_geometry(
    discs: int, seed: int, mutations: int, seconds: float, exact_contacts: int
) -> dict:
    """Search for the worst packing of equal discs.

    mutations: packings tried. seconds: limit of HiGHS for one target of the packing found, which is
    solved exactly if it has at most `exact_contacts` contacts.
    """
    rng = np.random.default_rng([seed, 5, discs])
    best = -np.inf
    seeds: list[int] = []
    for trial in range(mutations):
        tried = [int(s) for s in rng.integers(SEED_RANGE, size=discs)]
        if trial > RESTART_SHARE * mutations:
            changed = rng.choice(discs, size=int(rng.integers(1, 3)), replace=False)
            for k in range(discs):
                tried[k] = tried[k] if k in changed else seeds[k]
        try:
            graph = grow_from(tried)
        except ValueError:
            continue
        distance = graph.distances()
        value = search_violation(graph.gram, distance, seed, 1, ANNEALING_STEPS).value
        if value >= best:
            best = value
            seeds = tried
    return _describe(grow_from(seeds), seed, seconds, exact_contacts)


def _describe(graph: ContactGraph, seed: int, seconds: float, exact_contacts: int) -> dict:
    gram = graph.gram
    distance = graph.distances()
    kinds = distinct_contacts(gram, distance)
    worst = search_violation(gram, distance, seed, LONG_STARTS, LONG_STEPS)
    found = worst.value
    exact = None
    if len(gram) <= exact_contacts:
        optimum = exact_violation(gram, distance, kinds, seconds)
        agree = found <= optimum.value * (1.0 + AGREEMENT)
        value = max(found, optimum.value) if agree else optimum.value
        exact = value if optimum.proven else None
    return {
        "n": len(graph.centres),
        "contacts": len(gram),
        "search": found,
        "exact": exact,
        "bound": bound_violation(gram, distance, kinds),
        "centres": graph.centres.tolist(),
        "pairs": graph.pairs.tolist(),
        "worst_order": worst.order.tolist(),
        "worst_gaps": worst.gaps.tolist(),
        "worst_target": worst.target,
    }
