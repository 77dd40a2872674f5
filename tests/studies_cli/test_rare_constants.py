"""Tails by splitting: exact tails of a simple law, and packings that are those of `grow`."""

import numpy as np
import pytest

from nsbench.compilation.factories import without_compilation
from nsbench.studies.lemma.adversarial_search import search_fixed_order
from nsbench.studies.lemma.figures import draw_distribution
from nsbench.studies.lemma.kernels.uniform_growth import grow_uniform
from nsbench.studies.lemma.multilevel_splitting import (
    Score,
    estimate_tail,
    mean_interval,
    place_levels,
)
from nsbench.studies.lemma.random_packings import LOOPS
from nsbench.studies.lemma.rare_constants import (
    ATTEMPTS,
    KEYS,
    NUMBERS,
    compare_with_plain,
    packing_score,
)
from nsbench.studies.packings.contact_graphs import CLEARANCE, ContactGraph, _propose

SUM = Score(3, [slice(k, k + 1) for k in range(3)], lambda x: x.sum())
THRESHOLDS = [1.0, 2.3, 2.7, 2.85]
EXACT = [5 / 6, *((3.0 - t) ** 3 / 6.0 for t in THRESHOLDS[1:])]  # of a sum of three
DISCS = 12


def repeat(steps, runs=200, points=40):
    levels = [2.0, 2.4, 2.6, 2.75]
    return np.array(
        [
            estimate_tail(SUM, points, steps, levels, THRESHOLDS, np.random.default_rng([3, k]))
            for k in range(runs)
        ]
    )


@pytest.mark.parametrize("steps", [1, 3])
def test_estimates_are_unbiased_even_where_points_hardly_move(steps):
    estimates = repeat(steps)
    error = estimates.std(axis=0, ddof=1) / np.sqrt(len(estimates))
    assert np.all(np.abs(estimates.mean(axis=0) - EXACT) < 4.0 * error)
    assert np.all(error < 0.2 * np.array(EXACT))  # a wide error would hide anything


def test_intervals_over_runs_hold_the_exact_value_about_as_often_as_they_say():
    estimates = repeat(2)[:, 2].reshape(20, 10)
    held = 0
    for group in estimates:
        mean, low, high = mean_interval(group, 0.95)
        assert low <= mean <= high
        held += low <= EXACT[2] <= high
    assert 16 <= held <= 20


def test_levels_divide_the_tail_down_to_the_rarest_probability():
    levels = place_levels(SUM, 200, 4, 1e-4, np.random.default_rng(1))
    tail = [(3.0 - v) ** 3 / 6.0 if v > 2.0 else 1.0 for v in levels]
    assert levels == sorted(levels) and 1e-5 < tail[-1] < 1e-3
    assert len(levels) == 6  # a fifth each: 0.2^6 < 1e-4 < 0.2^5


def test_a_score_that_nothing_passes_has_no_levels_and_no_tail():
    flat = Score(1, [slice(0, 1)], lambda x: 1.0)
    rng = np.random.default_rng(0)
    assert place_levels(flat, 10, 1, 1e-3, rng) == []
    assert estimate_tail(flat, 10, 1, [1.0], [0.5, 1.0, 2.0], rng) == [1.0, 0.0, 0.0]


class Scripted:
    """A generator that returns the numbers of one attempt, as kernels.uniform_growth reads them."""

    def __init__(self, numbers, side):
        self.p, self.q, self.r, _ = numbers
        self.side = side

    def integers(self, count):
        return int(self.p * count)

    def random(self):
        return self.q

    def normal(self, size):
        assert size == 2
        return np.array([np.cos(2.0 * np.pi * self.r), np.sin(2.0 * np.pi * self.r)])

    def choice(self, values, size=None, replace=True):
        if size is None:
            return self.side
        return np.sort(values)[[int(self.r * len(values))]]


def place_of(centres, numbers):
    """The place that an attempt of `grow` proposes, on the left of two discs if s < 1/2."""
    for side in (-1.0, 1.0):
        script = Scripted(numbers, side)
        place, touched = _propose(centres, np.ones(len(centres) + 1), LOOPS, script)
        if place is None or len(touched) == 1:
            return place, touched
        (ax, ay), (bx, by) = centres[touched[1]] - centres[touched[0]], place - centres[touched[0]]
        if (ax * by - ay * bx > 0.0) == (numbers[3] < 0.5):
            return place, touched
    raise AssertionError("neither side")


def test_packings_of_uniform_numbers_are_those_of_grow_and_so_are_their_constants():
    rng = np.random.default_rng(8)
    score = packing_score(DISCS)
    for _ in range(12):
        x = rng.random(score.size)
        numbers = x[: DISCS * ATTEMPTS * NUMBERS].reshape(DISCS, ATTEMPTS, NUMBERS)
        keys = x[DISCS * ATTEMPTS * NUMBERS :].reshape(DISCS, KEYS)
        centres = np.zeros((1, 2))
        pairs = []
        places = []
        for k in range(1, DISCS):
            for attempt in numbers[k]:
                place, touched = place_of(centres, attempt)
                if place is not None:
                    gaps = np.linalg.norm(centres - place, axis=1) - 2.0
                    gaps[touched] = np.inf
                    if gaps.min() >= CLEARANCE:
                        break
            centres = np.vstack((centres, place))
            pairs += [(i, k) for i in touched]
            places += list(keys[k, : len(touched)])
        found = np.zeros((DISCS, 2))
        found_pairs = np.zeros((2 * DISCS, 2), np.int64)
        m = without_compilation(grow_uniform)(numbers, LOOPS, CLEARANCE, found, found_pairs)
        assert found == pytest.approx(centres, abs=1e-9)
        assert found_pairs[:m].tolist() == [list(p) for p in pairs]
        graph = ContactGraph("scripted", centres, np.ones(DISCS), np.array(pairs))
        order = np.argsort(places)
        assert score.value(x) == pytest.approx(search_fixed_order(graph.gram, order), abs=1e-9)


def test_a_disc_without_a_place_has_no_constant():
    """All attempts put the fourth disc on the third."""
    score = packing_score(4)
    x = np.zeros(score.size)
    x[: 4 * ATTEMPTS * NUMBERS].reshape(4, ATTEMPTS, NUMBERS)[:, :, 1] = 1.0 - 1e-9
    assert score.value(x) == -1.0


def test_every_block_of_numbers_matters_and_no_number_lies_in_two():
    score = packing_score(DISCS)
    covered = np.concatenate([np.arange(b.start, b.stop) for b in score.blocks])
    first_disc = ATTEMPTS * NUMBERS + KEYS
    assert len(np.unique(covered)) == len(covered) == score.size - first_disc


def test_both_estimates_stand_side_by_side_up_to_the_last_level():
    tail = {"levels": [2.0], "thresholds": [1.0, 2.0, 2.5], "estimates": [[0.4, 0.1, 1], [0.6] * 3]}
    first, second = compare_with_plain(tail, np.array([0.0, 0.5] * 20 + [1.5, 1.7]))
    assert first["threshold"] == 1.0 and first["plain"][0] == 2 / 42
    mean, low, high = first["splitting"]
    # Student's t of one degree of freedom: 12.706 standard errors of 0.1
    assert (mean, high) == pytest.approx((0.5, 0.5 + 1.2706), rel=1e-4) and low == 0.0
    assert first["agree"] is True and second["agree"] is None
    apart = {**tail, "estimates": [[0.50, 0.1, 0.1], [0.51, 0.1, 0.1]]}
    assert compare_with_plain(apart, np.zeros(1000) + (np.arange(1000) < 2))[0]["agree"] is None
    assert compare_with_plain(apart, 2.0 * (np.arange(1000) < 2))[0]["agree"] is False


def test_one_axis_shows_what_plain_samples_and_splitting_say_of_the_tail():
    values = np.random.default_rng(4).random(500)
    tail = np.array([[0.5, 0.5, 0.4, 0.6], [2.0, 1e-7, 0.0, 2e-7], [2.5, 0.0, 0.0, 0.0]])
    svg = draw_distribution(values, 0.06, tail)
    assert "1e-06" in svg and "$" not in svg  # labels down to the rarest, in plain text
    assert "$" not in draw_distribution(values, 0.06, np.zeros((0, 4)))
