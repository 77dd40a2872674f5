"""Which order of a sweep leaves the least violation in its worst case, and what finding it costs.

Named orders (along the packing, from a rim inwards, by colours ...) are compared with the best one
that annealing over orders finds. The worst case of an order over all gaps comes from coordinate
ascent, which is a lower bound; the exact value of the best order by mixed-integer programming.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nsbench.studies.lemma.adversarial_search import search_fixed_order

HEAT = (0.05, 1e-3)  # first and last temperature
NEAR_BEST = 1.01  # cost is counted until the constant is within this factor of the best found
RANDOM_ORDERS = 41  # whose median is reported


@dataclass(frozen=True)
class BestOrder:
    """The best order found: its constant, the evaluations made, and those until nearly as good."""

    value: float
    order: np.ndarray
    evaluations: int
    evaluations_needed: int


def median_of_random_orders(gram: np.ndarray, seed: int) -> float:
    """Return the median constant of random orders."""
    rng = np.random.default_rng([seed, 3])
    values = [search_fixed_order(gram, rng.permutation(len(gram))) for _ in range(RANDOM_ORDERS)]
    return float(np.median(values))


def find_best_order(gram: np.ndarray, start: np.ndarray, seed: int, steps: int) -> BestOrder:
    """Anneal over orders, from `start`, for the smallest constant; steps: evaluations."""
    rng = np.random.default_rng([seed, 4])
    m = len(gram)
    order = np.array(start)
    value = search_fixed_order(gram, order)
    best = value
    best_order = order.copy()
    history = [best]
    for step in range(steps):
        k, place = rng.integers(m, size=2)
        moved = np.insert(np.delete(order, k), place, order[k])
        new = search_fixed_order(gram, moved)
        heat = HEAT[0] * (HEAT[1] / HEAT[0]) ** (step / max(1, steps))
        if new <= value or rng.random() < np.exp((value - new) / heat):
            value = new
            order = moved
        if value < best:
            best = value
            best_order = order.copy()
        history.append(best)
    needed = next(k for k, v in enumerate(history) if v <= NEAR_BEST * best)
    return BestOrder(best, best_order, len(history), needed + 1)
