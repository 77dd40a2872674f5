"""The fan: parts add up to the global error, and contacts wipe out what was before."""

import numpy as np
import pytest

import nsbench
from nsbench.studies.fan.windermere import CONTACT, EVENT, FREE, carry, open_fan, project


@pytest.fixture(scope="module")
def corner():
    """A point that slides down a wall and comes to rest in the corner, under PBD."""
    return open_fan(nsbench.get_case("wedge", psi=60.0, swell=0.5), "pbd", 2.0, 6)


@pytest.fixture(scope="module")
def wall():
    """The same while it slides on the wall."""
    return open_fan(nsbench.get_case("wedge", psi=60.0, swell=0.5), "pbd", 0.95, 6)


@pytest.mark.long
def test_parts_add_up_to_the_error_against_the_closed_form(corner, wall):
    assert corner.mismatch < 1e-6 and wall.mismatch < 1e-6
    assert np.abs(wall.error).max() > 1e-3


def test_an_error_that_is_rounding_is_made_of_no_parts():
    """Catching-up is exact in the corner."""
    case = nsbench.get_case("wedge", psi=60.0, swell=0.5)
    fan = open_fan(case, "catching_up", 2.0, 6)
    assert np.abs(fan.error).max() < 1e-15 and fan.mismatch < 0.01
    assert np.isnan(fan.share(CONTACT)) and np.isnan(fan.share_before_last_event())


def test_the_corner_forgets_and_only_the_last_sweep_is_left(corner):
    assert np.abs(corner.parts).max() < 1e-9
    assert corner.violation == pytest.approx(corner.error, rel=1e-6)


def test_phases_follow_the_motion(wall):
    assert wall.phases[0] == FREE and wall.phases[-1] == CONTACT and EVENT in wall.phases
    assert 0.0 < wall.share_before_last_event() <= wall.share(FREE) + 1e-9
    total = sum(wall.share(p) for p in (FREE, EVENT, CONTACT))
    assert total == pytest.approx(1.0, rel=1e-6)


def test_the_flow_starts_from_the_nearest_feasible_state():
    case = nsbench.get_case("tide")
    assert project(case, np.array([-0.1]), 1.0) == pytest.approx([0.0], abs=1e-12)
    assert carry(case, np.array([-0.1]), 2.0, 2.5) == pytest.approx(
        np.sin([2.0]) - np.sin([2.5]), abs=1e-9
    )


def test_a_run_that_does_not_end_well_is_no_fan():
    case = nsbench.get_case("tide").replace(start="error")
    with pytest.raises((ArithmeticError, ValueError)):
        open_fan(case.replace(x0=np.array([-0.5])), "pbd", 1.0, 2)
