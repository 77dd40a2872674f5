"""Clock of runs in interleaved rounds: seconds, and ratios that are reliable on a noisy machine.

Every round runs each of them once, beginning with another one each time; a disturbance meets all of
them alike. A ratio is the median of the ratios within rounds (not the ratio of medians), and comes
with its quartiles.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

ROUNDS = 7
FEWEST = 3  # of rounds: quartiles of less say nothing
TURNS = 0.03  # seconds: what the turns of one row may take together, if they are not FEWEST
# seconds: a run that takes longer is timed once. On a shared machine a run takes 1.7 times as long
# at one moment as at another: a curve whose runs were timed at different moments zigzags
LONG = 0.1
AGAIN = 5e-3  # seconds: a preparation that is quicker hides no compilation
# seconds: a run that is shorter is repeated within its turn until the turn lasts this long
LEAST = 0.02

_stood = 0.0  # seconds in which the clock of preparations and first calls stood still


def stand(seconds: float) -> None:
    """Take `seconds` off the clock, in which this process waited for another one to compile.

    They are no time of the run in which it waited.
    """
    global _stood
    _stood += seconds


def _now() -> float:
    """Return the time of the clock in seconds, less what `stand` has taken off."""
    return time.perf_counter() - _stood


@dataclass(frozen=True)
class Times:
    """Seconds of one run by round.

    seconds (rounds,); repeats: how often it ran within a turn.
    """

    seconds: np.ndarray
    repeats: int

    @property
    def median(self) -> float:
        """Return the median of the seconds by round."""
        return float(np.median(self.seconds))

    @property
    def quartiles(self) -> tuple[float, float]:
        """Return the lower and the upper quartile of the seconds by round."""
        low, high = np.percentile(self.seconds, (25, 75))
        return float(low), float(high)

    @property
    def worst(self) -> float:
        """Return the largest seconds of a round."""
        return float(self.seconds.max())


@dataclass(frozen=True)
class Ratio:
    """Ratio of two runs within rounds: median and quartiles."""

    median: float
    low: float
    high: float

    def __str__(self) -> str:
        return f"{self.median:.3g} [{self.low:.3g}, {self.high:.3g}]"


def rounds_of(seconds: float) -> int:
    """Choose the number of rounds in which a run of this length is timed.

    1 for runs of LONG seconds or more, else FEWEST to ROUNDS.
    """
    return 1 if seconds >= LONG else int(np.clip(TURNS / max(seconds, 1e-9), FEWEST, ROUNDS))


def columns(seconds: np.ndarray | Sequence[float]) -> dict:
    """Compute the columns of a row from the seconds of its rounds: quartiles, worst, number."""
    low, middle, high = (float(v) for v in np.percentile(seconds, (25, 50, 75)))
    return {
        "seconds": middle,
        "seconds_low": low,
        "seconds_high": high,
        "seconds_max": float(np.max(seconds)),
        "rounds": len(seconds),
    }


def in_rounds(
    runs: list[Callable[[], object]], rounds: list[int], announce: Callable[[int], None]
) -> list:
    """Time every run in its number of rounds; each round begins with another run.

    announce(i): called before run i is timed. Returns for each run its seconds, or what it raised
    in the first round that it did not end.
    """
    out: list[list[float] | Exception] = [[] for _ in runs]
    for r in range(max(rounds, default=0)):
        first = r * len(runs) // max(rounds)
        for i in (*range(first, len(runs)), *range(first)):
            if r < rounds[i] and not isinstance(out[i], Exception):
                announce(i)
                try:
                    out[i].append(_seconds(runs[i], 1))
                except (
                    Exception
                ) as e:  # it ended once; who asked is told of it, and the others are timed
                    out[i] = e
    return out


def prepared(prepare: Callable[[], Callable]) -> tuple[Callable, dict]:
    """Prepare a run twice; return it and the seconds this took.

    setup_seconds: what every preparation pays; compile_seconds: what the first one in a process
    pays beyond it: compilation, loading from caches, imports. Preparing twice separates them.
    """
    start = _now()
    run = prepare()
    first = again = _now() - start
    if first > AGAIN:
        start = _now()
        run = prepare()
        again = min(first, _now() - start)
    return run, {"setup_seconds": again, "compile_seconds": first - again}


def first_call(
    run: Callable[[], object], again: Callable[[], None] = lambda: None
) -> tuple[object, float, float]:
    """Call `run()`; return its result, its seconds, and those of numba's compiler within.

    A run that compiles is repeated, after a call of `again`: its seconds are those of the second
    call.
    """
    out, seconds, spent = watched(run)
    if spent > 0.0:
        again()
        out, seconds, _ = watched(run)
    return out, seconds, spent


def watched(run: Callable[[], object]) -> tuple[object, float, float]:
    """Call `run()`; return its result, its seconds, and those of numba's compiler.

    The latter include loading from numba's cache.
    """
    if "numba" not in sys.modules:
        start = _now()
        out = run()
        seconds = _now() - start
        return (
            out,
            seconds,
            seconds if "numba" in sys.modules else 0.0,
        )  # what imports numba will have compiled too
    from numba.core import event

    class Watch(event.Listener):
        depth = 0
        since = 0.0
        total = 0.0

        def on_start(self, _: object) -> None:
            self.since = self.since if self.depth else _now()
            self.depth += 1

        def on_end(self, _: object) -> None:
            self.depth -= 1
            self.total += 0.0 if self.depth else _now() - self.since

    watch = Watch()
    with event.install_listener("numba:compiler_lock", watch):
        start = _now()
        out = run()
        seconds = _now() - start
    return out, seconds, watch.total


def interleaved(
    runs: dict[str, Callable[[], object]], rounds: int = ROUNDS, least: float = LEAST
) -> dict[str, Times]:
    """Time each run, by name, over `rounds` rounds.

    Each is run once before, untimed, and that call determines how often it must be repeated in its
    turn to last `least` seconds. Runs must be ready: prepared and compiled.

    Raises ValueError for no runs or fewer than one round.
    """
    if not runs or rounds < 1:
        raise ValueError(f"{len(runs)} runs in {rounds} rounds; at least one of each is needed")
    names = list(runs)
    repeats = {n: max(1, int(np.ceil(least / max(_seconds(runs[n], 1), 1e-9)))) for n in names}
    seconds = {n: np.empty(rounds) for n in names}
    for r in range(rounds):
        turn = names[r % len(names) :] + names[: r % len(names)]
        for n in turn:
            seconds[n][r] = _seconds(runs[n], repeats[n])
    return {n: Times(seconds[n], repeats[n]) for n in names}


def _seconds(run: Callable[[], object], repeats: int) -> float:
    """Return the seconds of one of `repeats` calls of `run()`."""
    start = time.perf_counter()
    for _ in range(repeats):
        run()
    return (time.perf_counter() - start) / repeats


def ratio(one: Times, other: Times) -> Ratio:
    """Divide the seconds of `one` by those of `other`, round by round.

    Both must come from the same interleaved series.
    """
    low, middle, high = np.percentile(one.seconds / other.seconds, (25, 50, 75))
    return Ratio(float(middle), float(low), float(high))
