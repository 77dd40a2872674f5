"""Systems derived a second time, by an integrator of their own, come out to ten digits with no event missed or invented.

The truths are by the extrapolated midpoint rule at 45 digits, written without using the bench (tests/independent). This is
a quick part of them; tests/studies/independent.py runs all.
"""
import pytest
from independent import truths

import nsbench

SYSTEMS = {
    "walls": ("jump_forcing", "wall_rotating", "tiny", "lam_zero", "touch_tangent"),
    "narrow": ("wall_bump", "spike_2d", "spike_5e3", "dip_1e6", "near_miss", "narrow_dip", "fil_spike"),
    "distances": ("out_disc", "three_symm", "rods_1d"),
    "corners": ("dup_rows", "simul_1e9", "start_out"),
    "switches": ("surf_exits", "codim2_leave", "dry_friction", "belt"),
    "circuits": ("parallel_diodes", "two_diodes_d0", "relay_lcs"),
}


@pytest.mark.parametrize("name", [name for group in SYSTEMS.values() for name in group])
def test_a_second_derivation_agrees(name):
    traj = nsbench.solve(truths.case(name), "event_driven")
    errors = truths.compare(traj, truths.truth(name))
    assert traj.status.ok, str(traj.status)
    assert not errors.missed and not errors.extra
    assert errors.state < 1e-10 and errors.impulse < 1e-9 and errors.event < 1e-9


def test_every_system_has_a_truth_and_every_truth_a_system():
    assert truths.names() == sorted(path.stem for path in (truths.HERE / "cases").glob("*.py"))
    assert len(truths.names()) == 93
