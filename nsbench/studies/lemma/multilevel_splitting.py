"""Probabilities of rare events by multilevel splitting over independent uniform numbers.

For X uniform in [0, 1)^d, a score S and levels L_1 < L_2 < ..., points that do not pass a level are
replaced by ones that do, and Markov steps that keep the law of X given S(X) > L_j move all of them
(Au & Beck, Prob. Eng. Mech. 16, 2001; Cerou, Del Moral, Furon & Guyader, Stat. Comput. 22, 2012).
With levels that do not depend on the points the product of the shares that pass is an unbiased
estimate of P(S > L_j), whatever the numbers of points and steps (Del Moral, Feynman-Kac Formulae,
2004); so a first run places the levels and no more. Points of one run depend on one another:
intervals are those of Student's t over independent runs.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

PASSING = 0.2  # share of the points that passes a level of the first run
REDRAWN = 0.5  # share of the steps that draw a block anew
DECADES = 3.0  # of the lengths of the other steps, at most 1


@dataclass(frozen=True)
class Score:
    """A function S of `size` uniform numbers, and the blocks of numbers that a step changes."""

    size: int
    blocks: Sequence[slice]
    value: Callable[[np.ndarray], float]


class Points:
    """Points x (n, d) with their scores (n,), split and moved in place."""

    def __init__(self, score: Score, count: int, rng: np.random.Generator):
        self.score = score
        self.rng = rng
        self.x = rng.random((count, score.size))
        self.scores = np.array([score.value(x) for x in self.x])

    def split(self, level: float, steps: int) -> bool:
        """Replace points with S <= level by others and move all; False where none is above."""
        passing = np.flatnonzero(self.scores > level)
        failing = np.flatnonzero(self.scores <= level)
        if not passing.size:
            return False
        source = self.rng.choice(passing, len(failing))
        self.x[failing] = self.x[source]
        self.scores[failing] = self.scores[source]
        for _ in range(steps):
            for k in range(len(self.x)):
                self._move(k, level)
        return True

    def _move(self, k: int, level: float) -> None:
        """Propose one block of a point anew, or shift it around [0, 1); take it if S > level.

        Both proposals are as likely in return, so that the step is reversible (Metropolis).
        """
        rng = self.rng
        block = self.score.blocks[int(rng.integers(len(self.score.blocks)))]
        width = block.stop - block.start
        new = self.x[k].copy()
        if rng.random() < REDRAWN:
            new[block] = rng.random(width)
        else:
            length = 10.0 ** (-DECADES * rng.random())
            new[block] = (new[block] + length * rng.normal(size=width)) % 1.0
        value = self.score.value(new)
        if value > level:
            self.x[k] = new
            self.scores[k] = value


def place_levels(
    score: Score, points: int, steps: int, rarest: float, rng: np.random.Generator
) -> list[float]:
    """Return levels, each passed by a fifth of the points, down to the probability `rarest`.

    Fewer where no point passes any more.
    """
    levels: list[float] = []
    probability = 1.0
    now = Points(score, points, rng)
    while probability > rarest:
        level = float(np.quantile(now.scores, 1.0 - PASSING))
        share = float((now.scores > level).mean())
        if not now.split(level, steps):
            break
        levels.append(level)
        probability *= share
    return levels


def estimate_tail(
    score: Score,
    points: int,
    steps: int,
    levels: Sequence[float],
    thresholds: Sequence[float],
    rng: np.random.Generator,
) -> list[float]:
    """Return an unbiased estimate of P(S > t) for each threshold t, from one run.

    Each is the probability of the last level up to t times the share of the points beyond t. levels
    (ascending): chosen without this run.
    """
    out = np.zeros(len(thresholds))
    stages = np.searchsorted(levels, thresholds, side="right")
    probability = 1.0
    now = Points(score, points, rng)
    for stage in range(len(levels) + 1):
        for j in np.flatnonzero(stages == stage):
            out[j] = probability * (now.scores > thresholds[j]).mean()
        if stage < len(levels):
            probability *= float((now.scores > levels[stage]).mean())
            if not now.split(levels[stage], steps):
                break
    return out.tolist()


def mean_interval(estimates: np.ndarray, confidence: float) -> tuple[float, float, float]:
    """Return the mean of estimates of independent runs with its interval of Student's t.

    The estimates are of a probability: the interval ends at 0.
    """
    from scipy.stats import t

    runs = len(estimates)
    mean = float(np.mean(estimates))
    half = float(t.ppf(0.5 + confidence / 2.0, runs - 1) * np.std(estimates, ddof=1) / runs**0.5)
    return mean, max(0.0, mean - half), mean + half
