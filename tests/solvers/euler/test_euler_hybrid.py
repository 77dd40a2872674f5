"""Euler's method on hybrid systems: of order one, with transitions at the ends of steps."""

import numpy as np
import pytest
from hybrid_systems import ball, clock, constant, level, neuron, thermostat

from nsbench import Case, Hybrid, Transition, errors, solve, solvers

STEPS = 0.1 / np.geomspace(2.0, 600.0, 24).astype(int)


def order(make, name):
    """Slope of the error `name` over steps, which follow no ratio that the events could."""
    case = make()
    found = [errors(case, solve(case, "euler", h=h)) for h in STEPS]
    return np.polyfit(np.log(STEPS), np.log([e[name] for e in found]), 1)[0]


@pytest.mark.long
@pytest.mark.parametrize("name", ("state_sup", "impulse", "event_time"))
def test_is_of_order_one_in_states_modes_and_events(name):
    assert abs(order(thermostat, name) - 1.0) < 0.2


@pytest.mark.long
def test_is_of_order_one_where_the_state_jumps():
    assert abs(order(neuron, "event_time") - 1.0) < 0.2


def test_transitions_are_made_at_the_ends_of_steps():
    case = clock()
    traj = solve(case, "euler", h=0.25 / 3)
    assert [e.contact for e in traj.events] == [(0, 0), (0, 0)]
    ends = np.array([e.t for e in traj.events]) / (0.25 / 3)
    assert np.allclose(ends, np.round(ends)) and traj.status.ok
    assert traj.stats["loop"] == "host" and traj.stats["events"] == 2


def test_an_impact_below_the_floor_is_made_once():
    """The reset leaves the state under the floor, where the guard is positive still."""
    fall = lambda xp: lambda t, x: xp.array([x[1], -10.0 + 0.0 * x[0]])
    mirror = lambda xp: lambda t, x: xp.array([x[0], -0.8 * x[1]])
    hit = Transition("flight", level(0, 0.0, -1.0), "flight", mirror)
    case = Case("ball", Hybrid({"flight": fall}, (hit,)), np.array([1.0, 0.0]), np.linspace(0, 2, 9))
    traj = solve(case, "euler", h=1e-3)
    apart = np.diff([e.t for e in traj.events])
    assert traj.status.ok and len(apart) == 2 and np.all(apart > 0.3)


def test_a_guard_that_no_reset_changes_fires_once_each_time_it_rises():
    count = lambda xp: lambda t, x: x + 1.0
    wave = lambda xp: lambda t, x: xp.sin(t - 1.0)
    problem = Hybrid({"run": constant(0.0)}, (Transition("run", wave, "run", count),))
    case = Case("count", problem, np.zeros(1), np.linspace(0.0, 17.0, 18))
    traj = solve(case, "euler", h=0.01)
    assert np.allclose([e.t for e in traj.events], 1.0 + 2.0 * np.pi * np.arange(3), atol=0.011)
    assert traj.x[-1, 0] == 3.0


def test_the_ball_does_not_fall_through_the_floor_after_its_impacts_accumulate():
    traj = solve(ball(T=2.0), "euler", h=1e-3)
    assert traj.status.ok and np.all(traj.x[:, 0] > -0.05)


def test_a_circle_of_transitions_is_named():
    still = constant(0.0)
    both = (Transition("a", level(0, -1.0), "b"), Transition("b", level(0, -1.0), "a"))
    case = Case("circle", Hybrid({"a": still, "b": still}, both), np.zeros(1), np.linspace(0, 1, 5))
    traj = solve(case, "euler", h=0.1)
    assert traj.status.code == "chatter" and "circle" in str(traj.status)


def test_a_state_without_bounds_is_named():
    grow = lambda xp: lambda t, x: x * x
    case = Case("grow", Hybrid({"a": grow}, ()), np.array([50.0]), np.linspace(0, 9, 5))
    assert solve(case, "euler", h=0.1).status.code in ("diverged", "nan")


@pytest.mark.parametrize("spec", [s for s in solvers.standard() if s not in ("euler", "event_driven")])
def test_every_other_method_refuses_with_a_sentence(spec):
    why = solvers.get(spec).refuses(thermostat())
    assert why and why.endswith(".")
    assert "Filippov system." not in why and "complementarity system." not in why
