"""On synthetic ladders with known truth the intervals hold it, plateaus are seen and not invented,
divergence is told."""

from collections import Counter

import numpy as np
import pytest
from scipy.stats import binom
from studies.estimator import HONEST, TRUE, Count, study, totals
from studies.ladders import FAMILIES, ladders

# the seed of no run during development
N = 400
SEED = 20
RARE = 1e-3  # a right estimator fails one of these tests once in so many


@pytest.fixture(scope="module")
def counts():
    return study(N, SEED)[0]


@pytest.mark.long
def test_intervals_hold_the_order_in_93_to_97_of_100_where_the_model_holds(counts):
    c = totals(counts)["of them fair"]
    assert c.orders > 0.6 * c.n
    assert binom.ppf(RARE, c.orders, 0.93) <= c.covered <= binom.ppf(1 - RARE, c.orders, 0.97), (
        c.covered,
        c.orders,
    )


@pytest.mark.long
def test_intervals_seldom_miss_the_order_where_it_does_not(counts):
    c = totals(counts)["all that converge"]
    assert c.covered >= binom.ppf(RARE, c.orders, 0.92), (c.covered, c.orders)


def test_plateaus_are_invented_in_at_most_2_of_100(counts):
    c = totals(counts)["all that converge"]
    assert c.verdicts["plateau"] <= binom.ppf(1 - RARE, c.n, 0.02), c.verdicts


def test_a_plateau_of_four_times_the_rest_is_seen_in_9_of_10():
    c = study(100, SEED, ("plateau 4x",))[0]["plateau 4x"]
    assert c.verdicts["plateau"] >= binom.ppf(RARE, c.n, 0.9), c.verdicts


def test_a_plateau_is_seldom_called_an_order(counts):
    c = sum((counts[f] for f in counts if f.startswith("plateau")), Count())
    assert c.verdicts["order"] <= binom.ppf(1 - RARE, c.n, 0.05), c.verdicts


@pytest.mark.parametrize(
    "family, word",
    [
        ("diverging", "diverges"),
        ("exact", "exact: no order"),
        ("flat", "plateau"),
        ("hidden floor", "plateau"),
    ],
)
def test_what_does_not_converge_is_never_told_to(counts, family, word):
    told = counts[family].verdicts
    assert told["order"] == 0 and told[word] >= 0.8 * counts[family].n, told


@pytest.mark.parametrize("family", ["dyadic", "short", "sometimes exact"])
def test_what_cannot_be_known_has_no_verdict(counts, family):
    told = set(counts[family].verdicts) - {
        *HONEST,
        "exact: no order",
    }  # short ladders may lie in rounding altogether
    assert not told, counts[family].verdicts


def test_the_study_says_the_same_twice_and_knows_what_is_wrong():
    first, second = (list(ladders(60, 3)) for _ in range(2))
    assert all(
        a == b and np.array_equal(x.err, y.err, equal_nan=True)
        for (a, x), (b, y) in zip(first, second, strict=True)
    )
    assert Counter(name for name, _ in first).keys() == FAMILIES.keys()
    c = Count()
    lie = type("Fit", (), {"verdict": "order", "interval": (0.9, 1.1)})()
    for _, ladder in first:
        c.add(ladder, lie)
    assert c.wrong == sum(ladder.kind != "order" for _, ladder in first) > 0
    assert set(TRUE) == {ladder.kind for _, ladder in first}
