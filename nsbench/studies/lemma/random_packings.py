"""How likely large constants are: C of random packings in random orders.

For each sample a kissing graph is grown and an order drawn; C of that order is found by coordinate
ascent over the gaps (kernels.worst_case.worst_of_order). The share of samples in which the ascent
reaches the exact value of mixed-integer programming is measured on the first of them. Intervals are
exact binomial ones (Clopper & Pearson, 1934), bands of the distribution those of Massart (1990).
"""

from __future__ import annotations

import numpy as np

from nsbench.studies.packings.contact_graphs import ContactGraph, grow
from nsbench.studies.lemma.adversarial_search import search_fixed_order
from nsbench.studies.lemma.exact_constant import exact_violation
from nsbench.studies.packings.linear_sweep import longest_increasing_path

DISCS = (6, 25)  # least number of discs of a sample, and one more than the most
TYPICAL_DISCS = 12  # of the samples of the distribution
LOOPS = 0.5  # share of discs that are offered a place at two others
CONFIDENCE = 0.95
EXACT_SECONDS = 20.0  # limit of one target
EXACT_TOLERANCE = 1e-6  # relative, of the solver
FIELDS = ("constant", "discs", "contacts", "max degree", "longest increasing path")


def draw_sample(seed: int, index: int, discs: int | None) -> tuple[ContactGraph, np.ndarray]:
    """Draw a packing and an order of its contacts; discs None: a random number of them."""
    rng = np.random.default_rng([seed, 2, index])
    n = int(rng.integers(*DISCS)) if discs is None else discs
    graph = grow(n, int(rng.integers(1 << 31)), LOOPS)
    return graph, rng.permutation(len(graph.pairs))


def measure_block(seed: int, first: int, last: int, discs: int | None) -> list[list[float]]:
    """Measure samples `first` to `last` - 1; one row of FIELDS each."""
    out = []
    for k in range(first, last):
        graph, order = draw_sample(seed, k, discs)
        gram = graph.gram
        row = (
            search_fixed_order(gram, order),
            len(graph.centres),
            len(graph.pairs),
            graph.max_degree,
            longest_increasing_path(gram, order),
        )
        out.append([float(v) for v in row])
    return out


def compare_with_exact(seed: int, samples: int) -> dict[str, int]:
    """Count among the first samples those whose ascent value is below, at or above the exact one.

    "above" would be an error of one of the two. Samples that HiGHS does not finish are not counted.
    """
    out = {"below": 0, "equal": 0, "above": 0}
    for k in range(samples):
        graph, order = draw_sample(seed, k, TYPICAL_DISCS)
        gram = graph.gram
        contacts = list(range(len(gram)))
        exact = exact_violation(gram, graph.distances(), contacts, EXACT_SECONDS, order)
        if not exact.proven:
            continue
        excess = search_fixed_order(gram, order) - exact.value
        room = EXACT_TOLERANCE * exact.value
        out["equal" if abs(excess) <= room else "above" if excess > 0.0 else "below"] += 1
    return out


def share_interval(successes: int, samples: int) -> tuple[float, float]:
    """Return the interval of Clopper & Pearson of a probability."""
    from scipy.stats import beta

    tail = (1.0 - CONFIDENCE) / 2.0
    low = beta.ppf(tail, successes, samples - successes + 1) if successes else 0.0
    high = beta.ppf(1.0 - tail, successes + 1, samples - successes) if successes < samples else 1.0
    return float(low), float(high)


def quantile_interval(values: np.ndarray, level: float) -> tuple[float, float, float]:
    """Return a quantile of the distribution with its distribution-free interval."""
    from scipy.stats import binom

    values = np.sort(values)
    tail = (1.0 - CONFIDENCE) / 2.0
    count = len(values)
    low = int(np.clip(binom.ppf(tail, count, level) - 1, 0, count - 1))
    high = int(np.clip(binom.ppf(1.0 - tail, count, level), 0, count - 1))
    return float(np.quantile(values, level)), float(values[low]), float(values[high])


def band_width(samples: int) -> float:
    """Return the half width of the uniform confidence band of a distribution function (Massart)."""
    return float(np.sqrt(np.log(2.0 / (1.0 - CONFIDENCE)) / (2.0 * samples)))


def rank_correlations(rows: np.ndarray) -> dict[str, float]:
    """Return Spearman's rank correlation of the constant with each other field of `rows`."""
    from scipy.stats import spearmanr

    return {
        name: float(spearmanr(rows[:, 0], rows[:, j]).statistic)
        for j, name in enumerate(FIELDS)
        if j > 0
    }


def tail_share(values: np.ndarray, threshold: float) -> tuple[float, tuple[float, float]]:
    """Return the share of values above the threshold with its interval."""
    above = int((values > threshold).sum())
    return above / len(values), share_interval(above, len(values))
