"""Event-driven runs of Filippov systems nobody tuned for reach their closed forms to rounding,
events included."""

import numpy as np
import pytest
from filippov_corners import SEVERAL
from filippov_factories import constant, drift, entry
from filippov_systems import ONE

from nsbench import Case, Filippov, solve
from nsbench.dynamics.filippov.vector_field import FilippovVectorField


def run(made, k=41):
    problem, x0, T = made[:3]
    case = Case("hostile", problem, np.array(x0, float), np.linspace(0.0, T, k))
    return case, solve(case, "event_driven")


def order(events):
    return sorted(events, key=lambda e: (e[2], e[0]))


@pytest.mark.long
@pytest.mark.parametrize("make", [pytest.param(f, id=name) for name, f in (ONE | SEVERAL).items()])
def test_the_closed_form_is_met(make):
    made = make()
    case, traj = run(made)
    _, _, _, x, weights, events = made
    assert traj.status.ok, traj.status
    assert np.abs(traj.x - x(case.t)).max() <= 1e-12 * max(1.0, np.abs(x(case.t)).max())
    assert np.abs(traj.impulse - weights(case.t)).max() <= 1e-12
    found = order((e.t, e.kind, e.contact[1]) for e in traj.events)
    assert [e[1:] for e in found] == [e[1:] for e in order(events)]
    np.testing.assert_allclose(
        [e[0] for e in found], [e[0] for e in order(events)], rtol=0, atol=1e-12
    )


SAME = {
    "line": (constant(1.0, 0.0), entry(1), (0.0, 0.0), lambda t: np.stack([t, 0 * t], 1)),
    "circle": (
        drift(lambda xp, t, x: xp.array([-x[1], x[0]])),
        drift(lambda xp, t, x: x[0:1] ** 2 + x[1:2] ** 2 - 1),
        (1.0, 0.0),
        lambda t: np.stack([np.cos(t), np.sin(t)], 1),
    ),
    "limit cycle": (
        drift(lambda xp, t, x: xp.array([-x[1], x[0]]) + x * (1 - x[0] ** 2 - x[1] ** 2)),
        drift(lambda xp, t, x: x[0:1] ** 2 + x[1:2] ** 2 - 1),
        (1.0, 0.0),
        lambda t: np.stack([np.cos(t), np.sin(t)], 1),
    ),
    "decay": (
        drift(lambda xp, t, x: xp.array([1.0, -x[1]])),
        entry(1),
        (0.0, 1.0),
        lambda t: np.stack([t, np.exp(-t)], 1),
    ),
    "unused sign": (
        drift(lambda xp, t, x: xp.array([x[1], -x[0]])),
        entry(1),
        (0.0, 0.0),
        lambda t: np.zeros((len(t), 2)),
    ),
}


@pytest.mark.long
@pytest.mark.survives("tangential")
@pytest.mark.parametrize("name", SAME)
def test_a_motion_along_a_surface_that_does_not_switch_has_no_events(name):
    field, switch, x0, x = SAME[name]
    case, traj = run((Filippov({(1,): field, (-1,): field}, switch), x0, 40.0))
    assert traj.status.ok and traj.events == () and traj.stats["restarts"] == 1
    assert np.abs(traj.x - x(case.t)).max() < 1e-10


@pytest.mark.survives("tangential")
def test_a_surface_that_does_not_switch_is_left_on_its_side():
    bend = drift(lambda xp, t, x: xp.array([1.0, x[0] ** 2]))
    case, traj = run((Filippov({(1,): bend, (-1,): bend}, entry(1)), (0.0, 0.0), 2.0))
    assert traj.status.ok and traj.events == ()
    np.testing.assert_allclose(traj.x, np.stack([case.t, case.t**3 / 3], 1), atol=1e-12)
    np.testing.assert_allclose(traj.impulse[:, 0], case.t, atol=1e-12)


@pytest.mark.survives("tangential")
def test_a_touch_is_told_from_an_entry_by_the_weight_in_between():
    # a belt touched to rounding has no events, one met 1e-4 too fast has short sticks
    case, traj = run(ONE["belt_that_is_touched"]())
    assert traj.stats["touches"] + len(traj.events) >= 1 and len(traj.events) == 1
    faster = solve(case.replace(x0=np.array([-0.2, 0.5 + 1e-4])), "event_driven")
    assert [e.kind for e in faster.events[:2]] == ["enter", "exit"]


def test_two_motions_in_one_corner_are_not_chosen_between():
    # rates bilinear in the signs with two solutions inside the square, (1/2, 1/2) and (-1/2, -1/2):
    # x' = s0 - s1, y' = 1/4 - s0 s1; the third coordinate tells which
    field = drift(lambda xp, t, x, s: xp.array([s[0] - s[1], 0.25 - s[0] * s[1], s[0]]))
    problem = Filippov.signs(field, drift(lambda xp, t, x: x[:2]))
    _, traj = run((problem, (0.0, 0.0, 0.0), 1.0))
    assert traj.status.code == "degenerate" and "not unique" in str(traj.status)
    found = FilippovVectorField(problem, 0.0, np.zeros(3)).sliding_solutions(
        0.0, np.zeros(3), np.zeros(2, np.int64)
    )
    np.testing.assert_allclose(
        sorted(s.tolist() for s in found), [[-0.5, -0.5], [0.5, 0.5]], atol=1e-14
    )


def test_dependent_surfaces_that_leave_the_velocity_open_are_told():
    # two relays on one surface, of which the second drags x2 along: how they share the load decides
    # its speed
    field = drift(lambda xp, t, x, s: xp.array([0.5 - s[0] - s[1], s[1]]))
    _, traj = run(
        (Filippov.signs(field, drift(lambda xp, t, x: xp.stack((x[0], x[0])))), (0.0, 0.0), 1.0)
    )
    assert traj.status.code == "degenerate"


@pytest.mark.parametrize("decay", [125.0, 150.0])
def test_a_switch_may_shrink_until_the_square_of_its_gradient_is_zero(decay):
    """c = exp(-decay t) (x - 10 sin t): the motion slides on x = 10 sin t, whatever the factor."""
    push = lambda v: lambda xp: lambda t, x: xp.array([v + 0.0 * t])
    switch = lambda xp: lambda t, x: xp.exp(-decay * t) * (x - 10.0 * xp.sin(t))
    problem = Filippov({(1,): push(-20.0), (-1,): push(20.0)}, switch)
    t = np.array([0.0, 1.0, 2.0, np.pi, 3.2])
    traj = solve(Case("s", problem, np.ones(1), t), "event_driven")
    assert traj.status.ok
    np.testing.assert_allclose(traj.x[1:, 0], 10.0 * np.sin(t[1:]), rtol=0.0, atol=1e-13)
