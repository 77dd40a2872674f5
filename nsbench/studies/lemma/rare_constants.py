"""How likely the largest constants of random packings are: their tail by multilevel splitting.

The packings and orders of random_packings with 12 discs, as functions of independent uniform
numbers (kernels.uniform_growth). C of a sample is what coordinate ascent finds, a lower bound: the
tail is that of this value.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nsbench.studies.lemma.multilevel_splitting import (
    Score,
    estimate_tail,
    mean_interval,
    place_levels,
)
from nsbench.studies.lemma.random_packings import CONFIDENCE, LOOPS, TYPICAL_DISCS, tail_share
from nsbench.studies.packings.contact_graphs import CLEARANCE, ORTHOGONAL

RARE_THRESHOLDS = (2.5, 2.7, 2.8, 2.9, 3.0, 3.05, 3.1)
ATTEMPTS = 100  # to place one disc; of 10^5 packings two need more than 50
NUMBERS = 4  # of one attempt
KEYS = 2  # most contacts of a disc with those before it
STREAM = 7  # of random numbers, beside those of the study's other parts


def packing_score(discs: int) -> Score:
    """Return C as a function of uniform numbers: of attempts (discs, ATTEMPTS, 4), then of keys.

    A step changes the attempts of one disc, which moves it and those that touch it, or the places
    of its contacts in the order. C = -1 where a disc finds no place.
    """
    from nsbench.studies.lemma.kernels.uniform_growth import constant_of_numbers

    of_disc = ATTEMPTS * NUMBERS
    first_key = discs * of_disc

    def value(x: np.ndarray) -> float:
        numbers = x[:first_key].reshape(discs, ATTEMPTS, NUMBERS)
        keys = x[first_key:].reshape(discs, KEYS)
        return constant_of_numbers(numbers, keys, LOOPS, CLEARANCE, ORTHOGONAL)

    # the first disc has neither: it lies at the origin
    blocks = [slice(k * of_disc, (k + 1) * of_disc) for k in range(1, discs)]
    keys = [first_key + k * KEYS for k in range(1, discs)]
    return Score(first_key + discs * KEYS, [*blocks, *(slice(k, k + KEYS) for k in keys)], value)


def find_levels(seed: int, points: int, steps: int, rarest: float) -> list[float]:
    """Return levels of C down to the probability `rarest`, from a run of their own."""
    rng = np.random.default_rng([seed, STREAM])
    return place_levels(packing_score(TYPICAL_DISCS), points, steps, rarest, rng)


def estimate_run(
    seed: int,
    run: int,
    points: int,
    steps: int,
    levels: Sequence[float],
    thresholds: Sequence[float],
) -> list[float]:
    """Return the estimates of P(C > c) of one run, numbered from 1."""
    rng = np.random.default_rng([seed, STREAM, run])
    score = packing_score(TYPICAL_DISCS)
    return estimate_tail(score, points, steps, levels, thresholds, rng)


def summarise_tail(tail: dict) -> np.ndarray:
    """Return rows (c, P(C > c), low, high) of the thresholds up to the last level.

    tail: "levels", "thresholds" (k,) and "estimates", one row of k per run. Intervals are those
    over runs.
    """
    last = max(tail["levels"], default=-np.inf)
    columns = np.array(tail["estimates"]).T
    pairs = zip(tail["thresholds"], columns, strict=True)
    rows = [(c, *mean_interval(column, CONFIDENCE)) for c, column in pairs if c <= last]
    return np.array(rows).reshape(-1, 4)


def compare_with_plain(tail: dict, values: np.ndarray) -> list[dict]:
    """Return both estimates of P(C > c) with their intervals for each threshold.

    values: C of packings drawn plainly. agree: the intervals have numbers in common; None where no
    plain value is above.
    """
    out = []
    for c, *splitting in summarise_tail(tail).tolist():
        _, low, high = splitting
        share, (least, most) = tail_share(values, c)
        out.append(
            {
                "threshold": c,
                "splitting": splitting,
                "plain": [share, least, most],
                "agree": least <= high and low <= most if share else None,
            }
        )
    return out
