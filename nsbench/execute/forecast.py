"""What runs will take, from what such runs took: seconds like a power of the accuracy, fitted to
rows of the journal.

Where a case and a solver have no rows, a few small runs are made (nsbench.execute.probe) within a
limit; where these do not reach, the solver's seconds per step and coordinate elsewhere are taken;
where it has none, those of all solvers.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from nsbench.measure import clock
from nsbench.study import Spec
from nsbench.study.plan import resolve

JOURNAL = "journal"
PROBE = "probe"
GUESS = "guess"
NOTHING = "refused"
PER_WORK = 1e-7  # seconds per step of one coordinate, where nothing at all is known
MEASURE = 0.02  # seconds of measuring a run, where no probe has told
SETTLED = 0.05  # seconds of compiling; a probe with more of it says nothing of what measuring takes
# power of the accuracy: a solver whose steps get dearer as they get shorter does not reach it
STEEPEST = 2.0
TYPICAL = {
    "h": 1.0,
    "tol": 0.2,
    "k": 0.5,
}  # powers where one accuracy alone is known: steps, orders of five and two
# in steps of one coordinate (0.1 us): measuring, a run by events, a step in Python
RUN = 1e4
EVENTS = 1e4
IN_PYTHON = 1e3
FEW = 6  # neighbours from which a power is fitted, so that a floor far away does not flatten it


@dataclass(frozen=True)
class Cost:
    """seconds in all of a run with its preparation and measuring; source: what it is known from."""

    seconds: float
    source: str


class Forecast:
    """rows: of any runs with their seconds, old ones too; probed: of small runs, with their `wall`
    beside."""

    def __init__(self, rows: Iterable[dict], probed: Iterable[dict] = ()):
        self.known: dict[tuple[str, str], dict[str, list]] = defaultdict(lambda: defaultdict(list))
        self.rates: dict[str, list[float]] = defaultdict(list)
        self.over: list[float] = []
        for source, several in ((JOURNAL, rows), (PROBE, probed)):
            for row in several:
                self._learn(source, row)

    def _learn(self, source, row):
        spent = row.get("seconds", np.nan)
        if not (isinstance(spent, float) and np.isfinite(spent) and np.isfinite(row["asked"])):
            return
        if source == PROBE and row["compile_seconds"] < SETTLED:
            twice = row["setup_seconds"] if row["setup_seconds"] > clock.AGAIN else 0.0
            self.over.append(
                max(
                    0.0, row["wall"] - spent - row["setup_seconds"] - twice - row["compile_seconds"]
                )
            )
        self.known[row["case"], row["solver"]][source].append(
            (row["asked"], spent, row.get("setup_seconds", 0.0), row.get("compile_seconds", 0.0))
        )

    def cost(self, spec: Spec) -> Cost:
        """Of one run, with all its rounds. A refusal costs nothing."""
        if not np.isfinite(spec.asked):
            return Cost(0.0, NOTHING)
        found = self.known.get((spec.case, spec.solver))
        if not found:
            return Cost(self._total(self.seconds(spec), 0.0), GUESS)
        source = JOURNAL if JOURNAL in found else PROBE
        return Cost(
            self._total(self.seconds(spec), float(np.median([row[2] for row in found[source]]))),
            source,
        )

    def seconds(self, spec: Spec) -> float:
        """Of the run alone, once."""
        found = self.known.get((spec.case, spec.solver))
        if not found:
            return self._guess(spec)
        asked, spent = np.array(
            [row[:2] for row in found[JOURNAL if JOURNAL in found else PROBE]]
        ).T
        at = np.isclose(asked, spec.asked, rtol=1e-9, atol=0.0)
        return (
            float(np.median(spent[at]))
            if at.any()
            else power_law(asked, spent, spec.asked, spec.accuracy)
        )

    def compiling(self, solvers: Iterable[str]) -> float:
        """Seconds of compiling and loading, as long as they have been at most for each solver: its
        cases share kernels."""
        longest: dict[str, float] = defaultdict(float)
        for (_, solver), found in self.known.items():
            longest[solver] = max(
                [longest[solver], *(row[3] for rows in found.values() for row in rows)]
            )
        return sum(longest[s] for s in {*solvers})

    def _total(self, seconds, setup):
        """Preparation, which is made twice where it is not quick; the first run; the rounds in
        which it is timed; measuring."""
        again = setup if setup > clock.AGAIN else 0.0
        rounds = clock.rounds_of(seconds)
        return (
            setup
            + again
            + seconds * (1 + (rounds if rounds > 1 else 0))
            + (float(np.median(self.over)) if self.over else MEASURE)
        )

    def _guess(self, spec):
        if not self.rates:
            self._fill_rates()
        rates = self.rates.get(spec.solver) or self.rates.get("") or [PER_WORK]
        return float(np.median(rates)) * work(spec)

    def _fill_rates(self):
        for (case, solver), found in self.known.items():
            accuracy = _accuracy_of(solver)
            for several in found.values():
                for asked, spent, *_ in several[:3]:
                    try:
                        w = work(Spec(case, solver, accuracy, asked))
                    except (LookupError, ValueError):  # a case of a file, or one that is no more
                        continue
                    self.rates[solver].append(spent / w)
                    self.rates[""].append(spent / w)


def power_law(asked, spent, at: float, accuracy: str) -> float:
    """Seconds at another accuracy: between known ones along the line through their logarithms,
    beyond with the power fitted to the nearest few. Steps ask for 1 / h, tolerances for less,
    stiffnesses for more the larger they are."""
    order = np.argsort(asked)
    x = np.log(asked[order])
    y = np.log(np.maximum(spent[order], 1e-9))
    place = float(np.log(at))
    if x[0] <= place <= x[-1]:
        return float(np.exp(np.interp(place, x, y)))
    end = slice(0, FEW) if place < x[0] else slice(-FEW, None)
    sign = 1.0 if accuracy == "k" else -1.0
    power = TYPICAL.get(accuracy, 1.0)
    if np.ptp(x[end]) > 0.0:
        power = sign * float(np.polyfit(x[end], y[end], 1)[0])
    edge = 0 if place < x[0] else -1
    return float(np.exp(y[edge] + sign * float(np.clip(power, 0.0, STEEPEST)) * (place - x[edge])))


def work(spec: Spec) -> float:
    """Steps times coordinates of a run, as far as they can be known before."""
    return weight([spec])


def weight(batch) -> float:
    """A guess of how long a batch takes, in steps of one coordinate: what every run needs, and what
    its steps do."""
    total = 0.0
    for s in batch:
        case = resolve(s.case, s.file)
        span = float(case.t[-1] - case.t[0])
        steps = {"h": span / s.asked, "k": span * s.asked / 3}.get(s.accuracy, EVENTS)
        if steps == steps:  # NaN: refused
            total += RUN + steps * (case.n + (IN_PYTHON if "backend=" in s.solver else 0))
    return total


def _accuracy_of(solver: str) -> str:
    from nsbench import solvers

    return solvers.get(solver).accuracy


def small(specs: Iterable[Spec]) -> list[Spec]:
    """The runs to probe among those of which nothing is known: for every case and solver the
    coarsest accuracy and one some way on; one pair of each solver first, those of little work
    before the others."""
    pairs: dict[tuple, list[Spec]] = {}
    for s in specs:
        if np.isfinite(s.asked):
            pairs.setdefault((s.case, s.file, s.solver), []).append(s)
    chosen = []
    for several in pairs.values():
        ranked = sorted(several, key=lambda s: s.asked, reverse=several[0].accuracy != "k")
        chosen.append(list(dict.fromkeys((ranked[0], ranked[len(ranked) // 3]))))
    chosen.sort(key=lambda two: work(two[0]))
    first = list({two[0].solver: two for two in reversed(chosen)}.values())
    rest = [two for two in chosen if not any(two is f for f in first)]
    return [s for two in (*first, *rest) for s in two]
