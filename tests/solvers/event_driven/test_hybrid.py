"""Hybrid systems: located transitions, limits at jumps, memory, chains, and how they can fail."""

import numpy as np
import pytest
from hybrid_systems import ball, clock, constant, level, neuron, thermostat

from nsbench import Case, Hybrid, Transition, errors, solve

STILL = constant(0.0)
UP = constant(1.0)
DOWN = constant(-1.0)


def system(modes, transitions, x0=(0.0,), T=2.0, samples=21):
    return Case("system", Hybrid(modes, transitions), np.array(x0), np.linspace(0.0, T, samples))


def made(traj):
    """Numbers and times of the transitions of a run."""
    return [e.contact[1] for e in traj.events], [e.t for e in traj.events]


@pytest.mark.long
@pytest.mark.parametrize("make", (ball, neuron, thermostat, clock))
@pytest.mark.parametrize("method", ("dop853", "rk45", "radau"))
def test_states_events_and_modes_are_those_of_the_closed_form(make, method):
    case = make()
    traj = solve(case, f"event_driven[method={method}]")
    found = errors(case, traj)
    assert traj.status.ok and traj.stats["roots"] == "verified"
    assert found["state_sup"] <= 1e-10 and found["event_time"] <= 1e-10
    assert found["events_missed"] == found["events_extra"] == 0
    assert not found["residual"] > 1e-9
    if case.exact_impulse is not None:
        assert found["impulse"] <= 1e-10


def test_a_looser_tolerance_is_kept_too():
    found = errors(neuron(), solve(neuron(), "event_driven", tol=1e-6))
    assert 1e-14 < found["state_sup"] <= 1e-5 and found["events_missed"] == 0


def test_the_period_of_a_thermostat_is_its_hysteresis():
    times = np.array(made(solve(thermostat(T=9.0), "event_driven"))[1])
    period = np.log(0.6 / 0.4) * 2.0
    assert len(times) == 22 and np.allclose(times[2:] - times[:-2], period, atol=1e-12)


def test_a_clock_whose_rate_is_that_of_its_mode():
    """x' = 1/2 up to x = 1, at t = 2; then 2 up to x = 3, at t = 3; then 0."""
    traj = solve(
        system(
            {"slow": constant(0.5), "fast": constant(2.0), "still": STILL},
            (Transition("slow", level(0, 1.0), "fast"), Transition("fast", level(0, 3.0), "still")),
            T=4.0,
        ),
        "event_driven",
    )
    exact = np.interp(traj.t, (0.0, 2.0, 3.0, 4.0), (0.0, 1.0, 3.0, 3.0))
    assert np.allclose(made(traj)[1], (2.0, 3.0), atol=1e-14)
    assert np.allclose(traj.x[:, 0], exact, atol=1e-14)
    assert np.allclose(traj.impulse[-1], (2.0, 1.0, 1.0), atol=1e-14)


def test_the_sample_at_a_jump_holds_the_limit_from_the_right():
    case = clock()
    traj = solve(case, "event_driven")
    at = np.searchsorted(case.t, (1.0, 3.0))
    assert np.allclose(traj.x[at], [[0.0, 0.5], [0.0, 0.25]], atol=1e-12)
    assert np.allclose(traj.x[at - 1], [[0.75, 1.0], [0.875, 0.5]], atol=1e-12)


@pytest.mark.parametrize("length, time", ((1e-3, 1.0), (1.0, 1e6), (1e5, 1e-4)))
def test_units_do_not_matter(length, time):
    case = ball(length=length, time=time)
    traj = solve(case, "event_driven")
    off = np.abs(traj.x - case.exact(case.t)) / np.array([length, length / time])
    assert traj.status.ok and off.max() < 1e-10
    assert np.allclose(made(traj)[1], [e.t for e in case.exact_events], rtol=1e-12)


def test_units_of_powers_of_two_give_the_same_bits():
    plain, other = (
        solve(ball(length=length, time=time), "event_driven")
        for length, time in ((1.0, 1.0), (2.0**20, 2.0**-7))
    )
    assert np.array_equal(plain.x[:, 0] * 2.0**20, other.x[:, 0])
    assert [e.t * 2.0**-7 for e in plain.events] == [e.t for e in other.events]


def test_impacts_that_accumulate_are_a_named_failure_at_their_time():
    traj = solve(ball(T=2.0), "event_driven")
    end = 3.0 * np.sqrt(0.2)
    assert traj.status.code == "chatter" and "accumulate" in str(traj.status)
    assert abs(traj.stats["accumulation"] - end) < 1e-8
    k = np.searchsorted(traj.t, end)
    assert np.all(np.isfinite(traj.x[:k])) and np.all(np.isnan(traj.x[k + 1 :]))


@pytest.mark.parametrize("restitution", (0.3, 0.8))
def test_impacts_that_accumulate_within_rounding_of_the_guard_are_named_too(restitution):
    """On a floor at y = 3 the last flights are lower than the rounding of y - 3."""
    flying = lambda xp: lambda t, x: xp.array([x[1], -10.0 + 0.0 * x[0]])
    bounce = lambda xp: lambda t, x: xp.array([3.0 + 0.0 * x[0], -restitution * x[1]])
    hit = Transition("flight", level(0, 3.0, -1.0), "flight", bounce)
    traj = solve(system({"flight": flying}, (hit,), (4.0, 0.0), T=9.0), "event_driven")
    end = np.sqrt(0.2) * (1.0 + restitution) / (1.0 - restitution)
    assert traj.status.code == "chatter" and "accumulate" in str(traj.status)
    assert abs(traj.stats["accumulation"] - end) < 1e-6


def test_transitions_at_one_instant_follow_one_another():
    """From a to b at x = 1, where b leaves at once for c, which resets x and is left later."""
    jump = lambda xp: lambda t, x: x - 1.0
    traj = solve(
        system(
            {"a": UP, "b": UP, "c": UP},
            (
                Transition("a", level(0, 1.0), "b"),
                Transition("b", level(0, 0.5), "c", jump),
                Transition("c", level(0, 0.75), "a"),
            ),
        ),
        "event_driven",
    )
    numbers, times = made(traj)
    assert traj.status.ok and numbers == [0, 1, 2, 0, 1]
    assert np.allclose(times, [1.0, 1.0, 1.75, 2.0, 2.0], atol=1e-12)
    assert np.allclose(traj.impulse[-1], [1.25, 0.0, 0.75], atol=1e-12)


def test_a_guard_at_zero_fires_where_the_motion_goes_on_to_the_far_side():
    """The target mode has the same guard: it is made at once if x rises there, never if x falls."""
    for drift, expected in ((UP, [0, 1]), (DOWN, [0])):
        traj = solve(
            system(
                {"a": UP, "b": drift, "c": STILL},
                (Transition("a", level(0, 1.0), "b"), Transition("b", level(0, 1.0), "c")),
            ),
            "event_driven",
        )
        assert traj.status.ok and made(traj)[0] == expected


def test_a_guard_that_has_passed_at_the_start_fires_there():
    for x0, expected in ((1.5, [0]), (1.0, [0]), (0.5, [])):
        traj = solve(
            system(
                {"a": UP, "b": STILL}, (Transition("a", level(0, 1.0), "b"),), (x0,), T=0.25
            ),
            "event_driven",
        )
        assert traj.status.ok and made(traj) == (expected, [0.0] * len(expected))


def test_a_guard_at_zero_at_the_start_that_turns_away_does_not_fire():
    traj = solve(
        system({"a": DOWN, "b": STILL}, (Transition("a", level(0, 1.0), "b"),), (1.0,)),
        "event_driven",
    )
    assert traj.status.ok and not traj.events and np.isclose(traj.x[-1, 0], -1.0)


def test_of_guards_that_pass_at_one_instant_the_first_of_the_list_fires():
    late = lambda xp: lambda t, x: t - 1.0
    for guards in ((level(0, 1.0), late), (late, level(0, 1.0))):
        traj = solve(
            system(
                {"a": UP, "b": STILL, "c": STILL},
                (Transition("a", guards[0], "b"), Transition("a", guards[1], "c")),
            ),
            "event_driven",
        )
        assert made(traj)[0] == [0]


def test_many_neurons_spike_at_one_instant():
    """Ten that are alike: ten transitions of one instant are no accumulation."""
    n = 10
    charge = lambda xp: lambda t, x: 1.0 + 0.0 * x

    def spike(i):
        return lambda xp: lambda t, x: x * xp.asarray(1.0 - np.eye(n)[i])

    transitions = tuple(Transition("on", level(i, 1.0), "on", spike(i)) for i in range(n))
    traj = solve(system({"on": charge}, transitions, np.zeros(n), T=2.5), "event_driven")
    assert traj.status.ok and made(traj)[0] == [*range(n), *range(n)]
    assert np.allclose(traj.x[-1], 0.5, atol=1e-12)


def test_a_circle_of_transitions_without_time_between_is_named():
    relay = (Transition("up", level(0, 1.0), "down"), Transition("down", level(0, 1.0, -1.0), "up"))
    traj = solve(system({"up": UP, "down": DOWN}, relay), "event_driven")
    assert traj.status.code == "chatter" and abs(traj.events[-1].t - 1.0) < 1e-12
    assert "up -> down" in str(traj.status) and "Filippov" in str(traj.status)


def test_a_guard_that_touches_zero_is_no_event_and_one_that_just_passes_is():
    for depth, events in ((0.0, 0), (-1e-9, 0), (1e-9, 1)):

        def wave(xp, depth=depth):
            return lambda t, x: xp.sin(x[0]) - 1.0 + depth

        traj = solve(
            system({"a": UP, "b": UP}, (Transition("a", wave, "b"),), T=3.0), "event_driven"
        )
        assert traj.status.ok and len(traj.events) == events
        if events:
            assert abs(traj.events[0].t - np.arcsin(1.0 - depth)) < 1e-7


def counter(guard, T):
    """One mode that counts how often a guard rises through zero that no reset changes."""
    count = lambda xp: lambda t, x: xp.array([x[0] + 1.0, x[1]])
    run = constant(0.0, 1.0)
    return system({"run": run}, (Transition("run", guard, "run", count),), (0.0, 0.0), T)


@pytest.mark.parametrize(
    "guard, times",
    (
        (lambda xp: lambda t, x: xp.sin(t - 1.0), (1.0, 1.0 + 2.0 * np.pi, 1.0 + 4.0 * np.pi)),
        (lambda xp: lambda t, x: xp.sin(x[1] - 1.0), (1.0, 1.0 + 2.0 * np.pi, 1.0 + 4.0 * np.pi)),
        (lambda xp: lambda t, x: t - 6.0 * xp.floor(t / 6.0) - 4.0, (4.0, 10.0, 16.0)),
        (lambda xp: lambda t, x: 3.0 - (t - 6.0 * xp.floor(t / 6.0)), (0.0, 6.0, 12.0)),
    ),
    ids=("time", "state", "ramp", "jump"),
)
def test_a_guard_that_no_reset_changes_fires_once_each_time_it_rises(guard, times):
    traj = solve(counter(guard, 17.0), "event_driven")
    assert traj.status.ok and np.allclose(made(traj)[1], times, atol=1e-10)
    assert traj.x[-1, 0] == len(times)


@pytest.mark.long
def test_a_guard_that_jumps_often_does_not_accumulate():
    jump = lambda xp: lambda t, x: 3.0 - (t - 6.0 * xp.floor(t / 6.0))
    traj = solve(counter(jump, 185.0), "event_driven")
    assert traj.status.ok and np.allclose(made(traj)[1], 6.0 * np.arange(31), atol=1e-10)


def test_hysteresis_remembers():
    """The same input value under a rising and a falling input, in two modes."""
    ramp = lambda xp: lambda t, x: xp.array([xp.cos(t)])  # x = sin t
    case = Case(
        "memory",
        Hybrid(
            {"low": ramp, "high": ramp},
            (
                Transition("low", level(0, 0.5), "high"),
                Transition("high", level(0, -0.5), "low", direction=-1),
            ),
        ),
        np.zeros(1),
        np.linspace(0.0, 2.0 * np.pi, 9),
    )
    traj = solve(case, "event_driven")
    assert np.allclose(made(traj)[1], [np.pi / 6.0, np.pi * 7.0 / 6.0], atol=1e-11)
    low = np.pi / 6.0 + np.pi * 5.0 / 6.0
    assert np.allclose(traj.impulse[-1], [low, 2.0 * np.pi - low], atol=1e-10)


@pytest.mark.parametrize("value", (np.nan, np.inf))
def test_a_reset_that_is_not_finite_is_named(value):
    bad = lambda xp: lambda t, x: xp.where(t > 0.5, value, x)
    traj = solve(
        system({"a": UP}, (Transition("a", level(0, 1.0), "a", bad),)), "event_driven"
    )
    assert traj.status.code == "nan" and "a -> a" in str(traj.status)


def test_max_events_is_a_limit():
    traj = solve(neuron(T=20.0), "event_driven[max_events=5]")
    assert traj.status.code == "chatter" and "max_events" in str(traj.status)
