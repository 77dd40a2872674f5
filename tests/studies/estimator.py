"""How often `nsbench.fit_order` tells the truth, on synthetic ladders (ladders.py).

    python tests/studies/estimator.py --ladders 2000 --seed 0

One line per family: how many, how often the verdict is "order", how often its interval then holds
the true order, plateaus claimed (falsely, or rightly: power), and the other verdicts. "told wrong"
counts what must not happen: a plateau or "diverges" for an error that converges, an order for one
that does not, any verdict for what cannot be known.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

from ladders import FAMILIES, Ladder, ladders

from nsbench import fit_order

# what may be said beside the truth itself; "undecided" and "pre-asymptotic" are never wrong
HONEST = ("undecided", "pre-asymptotic")
TRUE = {
    "order": ("order", "below reference"),
    "plateau": ("plateau",),
    "diverges": ("diverges",),
    "exact": ("exact: no order",),
    "open": (),
}
SHORT = {
    "order": "order",
    "exact: no order": "exact",
    "plateau": "plateau",
    "pre-asymptotic": "pre-as.",
    "undecided": "undec.",
    "diverges": "diverg.",
    "below reference": "below",
}


@dataclass
class Count:
    """Outcomes of one family (or of several): verdicts, orders told and how many intervals held the
    truth."""

    n: int = 0
    orders: int = 0
    covered: int = 0
    converging: int = 0
    wrong: int = 0
    verdicts: Counter = field(default_factory=Counter)
    widths: list = field(default_factory=list)

    def add(self, ladder: Ladder, fit) -> None:
        self.n += 1
        self.verdicts[fit.verdict] += 1
        self.converging += ladder.kind == "order"
        if fit.verdict == "order" and ladder.kind == "order":
            self.orders += 1
            self.covered += fit.interval[0] <= ladder.p <= fit.interval[1]
            self.widths.append(fit.interval[1] - fit.interval[0])
        self.wrong += fit.verdict not in HONEST + TRUE[ladder.kind]

    @property
    def coverage(self) -> float:
        return self.covered / self.orders if self.orders else float("nan")

    def __add__(self, other: Count) -> Count:
        return Count(*(getattr(self, k) + getattr(other, k) for k in self.__dataclass_fields__))


def study(
    n: int, seed: int, families=tuple(FAMILIES)
) -> tuple[dict[str, Count], dict[tuple, Count]]:
    """(by family, by family and note)."""
    counts = {}
    notes = {}
    for family, ladder in ladders(n, seed, families):
        fit = fit_order(ladder.h, ladder.err, **ladder.known)
        counts.setdefault(family, Count()).add(ladder, fit)
        notes.setdefault((family, ladder.note), Count()).add(ladder, fit)
    return counts, notes


def totals(counts: dict[str, Count]) -> dict[str, Count]:
    """All orders told; those of families whose assumptions hold; all that converges; the plateaus
    of 4 times the rest."""
    order = [f for f in counts if counts[f].converging]
    groups = {"all that converge": order, "of them fair": [f for f in order if FAMILIES[f][2]]}
    return {name: sum((counts[f] for f in group), Count()) for name, group in groups.items()}


def line(name: str, c: Count) -> str:
    half = 1.96 * np.sqrt(c.coverage * (1 - c.coverage) / c.orders) if c.orders else float("nan")
    width = f"{np.median(c.widths):6.3f}" if c.widths else "     -"
    cover = f"{100 * c.coverage:5.1f} ±{100 * half:4.1f}" if c.orders else "      -     "
    rest = " ".join(f"{SHORT[v]} {k}" for v, k in c.verdicts.most_common())
    return (
        f"{name:26s} {c.n:6d} {100 * c.verdicts['order'] / c.n:6.1f}  {cover} {width} "
        f"{100 * c.verdicts['plateau'] / c.n:8.1f} {100 * c.wrong / c.n:8.2f}   {rest}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--ladders", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--notes", action="store_true", help="also by level of noise and size within a family"
    )
    parser.add_argument(
        "--families", nargs="*", default=list(FAMILIES), choices=list(FAMILIES), metavar="NAME"
    )
    args = parser.parse_args()
    counts, notes = study(args.ladders, args.seed, tuple(args.families))
    print(
        f"{'family (* assumptions hold)':26s} {'n':>6s} {'order%':>6s}  {'coverage %':>12s} "
        f"{'width':>6s} "
        f"{'plateau%':>8s} {'wrong%':>8s}   verdicts"
    )
    for family, c in counts.items():
        print(line(f"{family} {'*' if FAMILIES[family][2] else ''}", c))
        if args.notes:
            for (f, note), d in sorted(notes.items()):
                if f == family and note:
                    print(line(f"    {note}", d))
    for name, c in totals(counts).items():
        if c.n:
            print(line(name, c))


if __name__ == "__main__":
    main()
