"""Metamorphic study: units, origins and horizons changed on all cases by all methods.

    python tests/studies/metamorphic.py [--cases slide_exit tide] [--methods pbd]

Every case that a method takes is run as it is and changed (tests/support/changed_cases.py): units
of length and time by powers of two, where equal bits are expected; by powers of ten from 1e-18 to
1e18, and of each coordinate by itself, where rounding is; a switch in another unit, a clock that
starts elsewhere, a bystander, a longer run. One line for each difference beyond what is allowed,
then runs, relations and violations. Every run has the default accuracy of its method.
"""

import argparse
import sys
import time
import warnings
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "support"))
from changed_cases import ROUNDING, beside, differences, longer, units  # noqa: E402

from nsbench import LCS, Complementarity, Filippov  # noqa: E402
from nsbench.case import get_case  # noqa: E402
from nsbench.solvers import get  # noqa: E402
from nsbench.study import plan  # noqa: E402

METHODS = (
    "event_driven",
    "pbd",
    "catching_up",
    "theta",
    "euler",
    "euler[implicit=true]",
    "richardson",
)
TWOS = ((2.0**-30, 2.0**20), (2.0**17, 2.0**-40))
TENS = ((1e-18, 1e15), (1e12, 1e-18))


def relations(case):
    """(name, changed case, are equal bits expected?)"""
    for T, L in TWOS:
        yield f"time {T:g}, length {L:g}", units(case, T, L), True
    for T, L in TENS:
        yield f"time {T:g}, length {L:g}", units(case, T, L), False
    if isinstance(case.problem, (Filippov, LCS)) and case.n > 1:
        lengths = 10.0 ** np.where(np.arange(case.n) % 2, 6.0, -9.0)
        yield "each coordinate", units(case, length=lengths), False
    if isinstance(case.problem, Filippov):
        yield "switch", units(case, gap=2.0**40), True
        yield "bystander", beside(case, 1e8), False
    if not isinstance(case.problem, Complementarity) or case.n < 100:
        yield "longer", longer(case, 1.5), False
    yield "origin", units(case, origin=-3.0), False


def main():
    """Run the study and print its violations."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--cases", nargs="*", default=None)
    parser.add_argument("--methods", nargs="*", default=METHODS, help="all but the penalty")
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    begun = time.time()
    count = violations = 0
    for name in args.cases or plan.suite_cases("standard"):
        case = get_case(name)
        for method in args.methods:
            if get(method).refuses(case):
                continue
            for relation, changed, exact in relations(case):
                if relation == "longer" and method != "event_driven":
                    continue  # steps of another length
                count += 1
                try:
                    found = differences(case, method, changed)
                except Exception as e:
                    found = {"raised": f"{type(e).__name__}: {e}"}
                allowed = 0.0 if exact else ROUNDING
                if any(isinstance(v, (str, tuple)) or not v <= allowed for v in found.values()):
                    violations += 1
                    print(f"{name} {method}: {relation}: {found}", flush=True)
    print(f"{count} pairs of runs, {violations} violations, {time.time() - begun:.0f} s")


if __name__ == "__main__":
    main()
