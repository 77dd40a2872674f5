"""No passage is missed and none is invented: a part of the study of 1000."""

import numpy as np
import pytest
from studies.grazes import KINDS, judge, passage, pick


@pytest.mark.long
@pytest.mark.survives("graze")
@pytest.mark.parametrize("first", range(0, 60, 20))
def test_random_passages_are_found_with_their_times_and_ends(first):
    bad = {k: v for k in range(first, first + 20) if (v := judge(pick(k, seed=1))[0]) != "good"}
    assert not bad


@pytest.mark.survives("graze")
@pytest.mark.parametrize("kind", KINDS)
def test_one_point_of_contact_is_no_event_and_a_contact_of_a_thousandth_is_two(kind):
    rng = np.random.default_rng(3)
    for length, clear in ((0.0, 0.0), (1e-3, 0.0), (0.0, 1e-12)):
        assert judge(passage(kind, length, clear, rng))[0] == "good", (length, clear)
