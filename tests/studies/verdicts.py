"""Is the method that a report calls the cheapest at an error the cheapest one?

    nsbench run SCENES -j 1 -o DIR
    nsbench run SCENES -j 1 -o FINER --reach 1e-6 --budget 60
    python tests/studies/verdicts.py DIR FINER

One line for each case and error: the quickest method that the report of DIR names, with "~" where
its step is extrapolated, and what FINER says, where every method goes on until it reaches the error or its
budget is spent. Costs of both are those of FINER. At the end how often the choice is the cheapest
one, how often another one is within TIE, and the largest factor lost; exit status 1 if one is
above TIE.
"""

import argparse
import sys

from nsbench.report import cost
from nsbench.report.answers.best_method import best_of_page, cheapest
from nsbench.report.data import Data, read
from nsbench.report.summary import summarise

TIE = 1.25  # runs of a millisecond differ by as much between two rounds


def said(data: Data, case: str, target: float) -> cost.Cost | None:
    """Return the quickest method that the report of these rows names; None: none at all."""
    best = best_of_page(data, summarise(data), case, target)
    return best.further or best.cost


def main() -> int:
    """Print a line for each case and error."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("results")
    parser.add_argument("finer")
    args = parser.parse_args()
    data = read(args.results)
    finer = read(args.finer)
    lost = []
    for case in data.case_keys:
        for target in cost.TARGETS:
            choice = said(data, case, target)
            ranked = cost.rank_costs(finer, case, target)
            if choice is None or not ranked:
                one = choice.solver if choice else "none"
                count = f"{len(ranked)} methods reach it"
                print(f"{case:24} {target:g} said {one}, {count}", flush=True)
                lost.append(float("inf") if choice or ranked else 1.0)
                continue
            best = cheapest(ranked)
            true = {c.solver: c.seconds for c in ranked}.get(choice.solver, float("inf"))
            lost.append(true / best.seconds)
            print(
                f"{case:24} {target:g} said {'~' * choice.is_extrapolated}{choice.solver} "
                f"{choice.seconds:.3g} s; is {best.solver} {best.seconds:.3g} s, the choice "
                f"{true:.3g} s: factor {lost[-1]:.2f}",
                flush=True,
            )
    exact = sum(f == 1.0 for f in lost)
    near = sum(1.0 < f <= TIE for f in lost)
    print(f"{len(lost)} choices: {exact} the cheapest, {near} within {TIE}, worst {max(lost):.3g}")
    return int(max(lost) > TIE)


if __name__ == "__main__":
    sys.exit(main())
