"""Scenes at the edge of what is usual: far away, few, all at once, exactly at a sample."""

import numpy as np
import pytest
from survive_files import METHODS, case_file, rows

import nsbench
from nsbench.solvers import solve

DISCS = {"constraints": "Distance(2.0),", "drift": "xp.array([1.0, 0, -1, 0]) + 0 * x"}


@pytest.mark.long
@pytest.mark.survives("far away")
def test_coordinates_of_1e8_cost_only_their_rounding(tmp_path):
    """Two discs that meet at t = 1, and the same 1e8 away: one ulp there is 1.5e-8, and the 200
    steps round as often."""
    near = nsbench.load_case(case_file(tmp_path, **DISCS, x0="[0.0, 0, 4, 0]", name="near"))
    far = nsbench.load_case(case_file(tmp_path, **DISCS, x0="[1e8, 1e8, 1e8 + 4, 1e8]", name="far"))
    for spec in ("pbd", "catching_up", "event_driven", "kdtree"):
        a = solve(near, spec)
        b = solve(far, spec)
        assert a.status.ok and b.status.ok and a.contacts == b.contacts, spec
        assert np.abs(b.x - 1e8 - a.x).max() < 400 * 1.5e-8
        assert np.abs(b.impulse - a.impulse).max() < 1e-5


@pytest.mark.long
@pytest.mark.survives("few particles")
@pytest.mark.parametrize("n", [1, 2])
def test_one_particle_is_free_and_two_meet(tmp_path, n):
    drift = {1: "xp.array([1.0, 0]) + 0 * x", 2: DISCS["drift"]}[n]
    found = rows(
        case_file(tmp_path, drift, "Distance(2.0),", {1: "[0.0, 0]", 2: "[0.0, 0, 4, 0]"}[n]),
        ("pbd", "pbd[order=cell]", "catching_up", "event_driven", "kdtree", "penalty"),
    )
    assert len(found) == 6 and {r["status"] for r in found.values()} == {"ok"}, found


@pytest.mark.long
@pytest.mark.survives("few particles")
def test_an_empty_family_of_walls_does_nothing(tmp_path):
    found = rows(case_file(tmp_path, constraints="Affine(np.zeros((0, 1)), np.zeros(0)),"))
    assert len(found) >= 5 and {r["status"] for r in found.values()} == {"ok"}, found


@pytest.mark.long
@pytest.mark.survives("many impacts")
def test_fifty_contacts_close_in_one_instant(tmp_path):
    """Between samples and on one: all of them at t = x0, to the same impulse."""
    for x0 in (1.0, 0.987):
        case = nsbench.load_case(
            case_file(
                tmp_path, constraints="Affine(np.eye(50), np.zeros(50)),", x0=f"np.full(50, {x0})"
            )
        )
        for spec in METHODS:
            traj = solve(case, spec)
            assert traj.status.ok and traj.x[-1] == pytest.approx(0.0, abs=1e-3), spec
            assert traj.impulse.shape[1] == 50 and traj.impulse[-1] == pytest.approx(
                2.0 - x0, abs=2e-2
            )


@pytest.mark.survives("event at a sample")
@pytest.mark.parametrize("x0, rest", [(0.0, 0.0), (1.0, 1.0), (2.0, 2.0)])
def test_a_contact_at_the_start_at_a_sample_or_at_the_end_is_met(tmp_path, x0, rest):
    case = nsbench.load_case(case_file(tmp_path, x0=f"[{x0}]"))
    want = np.maximum(x0 - case.t, 0.0)
    for spec in METHODS:
        traj = solve(
            case, spec, **({"h": 0.1} if spec in ("pbd", "catching_up", "theta", "kdtree") else {})
        )
        bound = 1e-3 if spec == "penalty" else 1e-12
        assert traj.status.ok and np.abs(traj.x[:, 0] - want).max() < bound, spec
        assert traj.impulse.sum(axis=1)[-1] == pytest.approx(2.0 - rest, abs=max(bound, 1e-9)), spec


@pytest.mark.long
@pytest.mark.survives("two events in a step")
@pytest.mark.parametrize("second", [0.502, 0.5010000001, 0.5])
def test_two_contacts_within_one_step_are_both_met(tmp_path, second):
    case = nsbench.load_case(
        case_file(tmp_path, constraints="Affine(np.eye(2), np.zeros(2)),", x0=f"[0.501, {second}]")
    )
    for spec in METHODS:
        traj = solve(
            case, spec, **({"h": 0.2} if spec in ("pbd", "catching_up", "theta", "kdtree") else {})
        )
        assert traj.status.ok and len(traj.contacts) == 2, spec
        assert traj.x[-1] == pytest.approx(0.0, abs=1e-3)
        assert sorted(traj.impulse[-1]) == pytest.approx([1.499, 2.0 - second], abs=1e-2)
    events = solve(case, "event_driven").events
    assert [e.t for e in events] == pytest.approx(sorted((0.501, second)), abs=1e-12)
