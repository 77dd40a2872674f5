"""Per cents of an overlap are of the diameter of hard particles, whatever links there are."""

import numpy as np
import pytest

from nsbench import Case, Complementarity, Distance, get_case
from nsbench.study.step_choice import demand_of


def at_rest(*families):
    def drift(xp):
        return lambda t, x: -x

    x0 = np.array([0.0, 0.0, 1.2, 0.0])
    return Case("pair", Complementarity(drift, families), x0=x0, t=np.linspace(0.0, 1.0, 3))


HARD = Distance(d=1.0)
LINK = Distance(d=1.5, sign=-1, pairs=np.array([[0, 1]]))


@pytest.mark.parametrize("families", [(HARD,), (HARD, LINK), (LINK, HARD)])
def test_one_per_cent_of_a_diameter(families):
    assert demand_of(at_rest(*families), "1%", "1%").overlap == pytest.approx(0.01)


def test_links_alone_are_measured_by_their_length():
    assert demand_of(at_rest(LINK), "1%", "1%").overlap == pytest.approx(0.015)


def test_discs_of_radius_one():
    assert demand_of(get_case("discs", n=3), "1%", "1%").overlap == pytest.approx(0.02)
