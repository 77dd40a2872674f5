"""Units of the penalty's stiffness k: 1 / time, or 1 / that of a switch."""

import changed_cases
import numpy as np
import pytest

from nsbench import solve
from nsbench.case import get_case
from nsbench.solvers import get
from nsbench.study.plan import ladder

NANO = {
    "tide": {"time": 1e-9},
    "three_discs": {"time": 1e-9},
    "slide_exit": {"length": 1e-9, "gap": 1e-9},
    "friction": {"length": 1e-9, "gap": 1e-9},
}


def error(case, changed, **accuracy):
    """Status and error over the range of the motion."""
    run = solve(changed.case, "penalty", **accuracy)
    true = solve(case, "event_driven").x
    return run.status, np.abs(changed.back(run.x) - true).max() / np.ptp(true)


@pytest.mark.parametrize("name", NANO)
def test_the_default_suits_nanoseconds_and_nanometres(name):
    case = get_case(name)
    status, found = error(case, changed_cases.units(case, **NANO[name]))
    plain, expected = error(case, changed_cases.units(case))
    assert status.ok and plain.ok
    assert found == pytest.approx(expected, rel=0.1)  # 2^30 and 1e9 differ by 7 %


@pytest.mark.parametrize("name", NANO)
def test_a_stiffness_of_ordinary_units_is_told_there(name):
    case = get_case(name)
    status, found = error(case, changed_cases.units(case, **NANO[name]), k=1e5)
    assert found > 0.1
    assert status.code == "unverified"


@pytest.mark.parametrize("name, changes", (("tide", {"time": 2.0**-30}), ("friction", {})))
def test_the_ladder_is_in_units_of_the_scene(name, changes):
    case = get_case(name)
    changed = changed_cases.units(case, gap=2.0**-30 if name == "friction" else 1.0, **changes)
    penalty = get("penalty")
    assert ladder(changed.case, penalty) == [2.0**30 * k for k in ladder(case, penalty)]


@pytest.mark.parametrize("k, code", ((1.0, "unverified"), (30.0, "ok")))
def test_springs_slower_than_the_scene_by_far_are_told(k, code):
    run = solve("stiff_contact", "penalty", k=k)
    assert run.status.code == code
    assert run.status.ok or "give way within 1 / k = 1" in str(run.status)
