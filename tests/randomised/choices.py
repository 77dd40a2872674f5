"""A scene is a list of small whole numbers: drawn at random, replayed, or drawn by hypothesis. Less
is simpler.

Everything that is random is asked of `below`; what a list of numbers does not say is 0. So a scene
is shrunk by making its numbers fewer and less, whatever they mean (as hypothesis does; MacIver &
Donaldson, ECOOP 2020).
"""

from __future__ import annotations

import math
from collections.abc import Callable

NICE = (0.0, 1.0, 0.5, -1.0, 2.0, -0.5)


class Choices:
    """below(n): a whole number from 0 to n - 1, of `source`; `made` keeps them all."""

    def __init__(self, source: Callable[[int], int]):
        self.source = source
        self.made = []

    def below(self, n: int) -> int:
        if n < 2:
            return 0
        self.made.append(int(self.source(n)))
        return self.made[-1]

    def pick(self, values):
        return values[self.below(len(values))]

    def rarely(self, n: int) -> bool:
        """True once in n."""
        return self.below(n) == n - 1

    def number(self, low: float, high: float) -> float:
        """A number of three digits between low and high, or a round one: both happen to be
        degenerate."""
        if self.below(4) == 0:
            return self.pick([v for v in NICE if low <= v <= high] or [low])
        digits = 3 - math.floor(math.log10(high - low))
        return round(low + (high - low) * self.below(1000) / 999.0, digits)


def drawn(rng) -> Choices:
    """Choices of a numpy random generator."""
    return Choices(lambda n: rng.integers(n))


def replayed(made: list[int]) -> Choices:
    """The same choices again; 0 where there are no more, the largest where there are fewer to
    choose from."""
    rest = iter(made)
    return Choices(lambda n: min(next(rest, 0), n - 1))


def shrunk(made: list[int], fails: Callable[[list[int]], bool], tries: int = 300) -> list[int]:
    """Choices, fewer and less, for which `fails` still holds; at most that many tries of it."""
    best = list(made)
    left = tries

    def better(trial):
        nonlocal best, left
        if left <= 0 or trial == best:
            return False
        left -= 1
        if not fails(trial):
            return False
        best = trial
        return True

    size = len(best)
    while size and left > 0:  # drop runs of them, then make single ones less
        k = 0
        while k < len(best) and left > 0:
            if not better(best[:k] + best[k + size :]):
                k += size
        size //= 2
    for k in range(len(best)):
        for less in (0, best[k] // 2 if k < len(best) else 0, best[k] - 1 if k < len(best) else 0):
            if k < len(best) and 0 <= less < best[k] and better([*best[:k], less, *best[k + 1 :]]):
                break
    return best
