"""Metamorphic study: units, origins and horizons changed on all cases by all methods.

    python tests/studies/metamorphic.py [--cases slide_exit tide] [--methods pbd]

Every case that a method takes is run as it is and changed (tests/support/changed_cases.py): units
of length and time by powers of two, where equal bits are expected; by powers of ten from 1e-18 to
1e18, and of each coordinate by itself, where rounding is; a switch in another unit, a clock that
starts elsewhere, a bystander, a longer run. One line for each difference beyond what is allowed,
then runs, relations and violations. Every run has the default accuracy of its method. The physics
is not compiled (tests/support/interpreted_physics.py), which would take most of the time.
"""

import argparse
import sys
import time
import warnings
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "support"))
from changed_cases import ROUNDING, beside, differences_from, longer, run, units  # noqa: E402
from interpreted_physics import patch_pointers  # noqa: E402

from nsbench import LCS, Complementarity, Filippov, errors  # noqa: E402
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
    "penalty",
)
# what rounding decides where the multipliers of a case are not unique: which contacts push
OF_CONTACTS = ("impulse", "events")
# of a coordinate's largest value: what step control leaves, up to 200 tolerances of the integrator;
# a compiler may fuse multiplications and additions of a changed field otherwise
OF_INTEGRATORS = {"penalty": 200e-9}
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


def is_due(case, method: str, relation: str, changed, exact: bool) -> bool:
    """Does the relation hold for this method on this case?

    Steps of a longer run have another length. Where explicit Euler steps on to a surface exactly,
    rounding decides on which side the next step goes.
    """
    if relation == "longer":
        return method == "event_driven"
    return exact or method != "euler" or "exact_at_grid" not in case.tags


def violations_of(name: str, method: str, changes: list, equal: Counter) -> int:
    """Compare the runs of the changed cases with that of the case; print and count violations.

    equal: counts the units by powers of two with equal bits (True) and others (False).
    """
    case = get_case(name)
    old = run(units(case).case, method)
    left_open = () if errors(case, old).get("multipliers_unique", True) else OF_CONTACTS
    count = 0
    for relation, changed, exact in changes:
        try:
            found = differences_from(case, old, method, changed)
        except Exception as e:
            found = {"raised": f"{type(e).__name__}: {e}"}
        if not exact:
            found = {k: v for k, v in found.items() if k not in left_open}
        allowed = OF_INTEGRATORS.get(method, 0.0 if exact else ROUNDING)
        equal[exact and all(v == 0.0 for v in found.values())] += exact
        if any(isinstance(v, (str, tuple)) or not v <= allowed for v in found.values()):
            count += 1
            print(f"{name} {method}: {relation}: {found}", flush=True)
    return count


def main():
    """Run the study and print its violations."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--cases", nargs="*", default=None)
    parser.add_argument("--methods", nargs="*", default=METHODS)
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    begun = time.time()
    count = violations = 0
    equal: Counter = Counter()
    with pytest.MonkeyPatch.context() as patch:
        patch_pointers(patch)
        for name in args.cases or plan.suite_cases("standard"):
            case = get_case(name)
            every = list(relations(case))  # once: the methods share what is prepared of a case
            for method in args.methods:
                if get(method).refuses(case):
                    continue
                fits = [r for r in every if is_due(case, method, *r)]
                count += len(fits)
                violations += violations_of(name, method, fits, equal)
            print(f"{name}: {count} pairs, {time.time() - begun:.0f} s", file=sys.stderr)
    print(f"powers of two: equal bits in {equal[True]} of {equal.total()} pairs")
    print(f"{count} pairs of runs, {violations} violations, {time.time() - begun:.0f} s")


if __name__ == "__main__":
    main()
