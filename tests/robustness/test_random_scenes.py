"""Two integrators at two tolerances agree on random scenes of every kind: a part of the study of
500."""

import pytest
from studies.random_scenes import AGREE, KINDS, differ, scene, twice


@pytest.mark.long
@pytest.mark.survives("silent wrong")
@pytest.mark.parametrize("kind", KINDS)
def test_two_runs_agree_or_say_why_not(kind):
    for n, seed in ((3, 1), (6, 2)):
        a, b = twice(scene(kind, n, seed))
        assert not (a.status.ok and b.status.ok) or differ(a, b) <= AGREE
        assert a.status.ok, a.status
