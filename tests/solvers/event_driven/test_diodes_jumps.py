"""Linear complementarity systems whose inputs jump: the jump is found wherever it lies in a
step."""

import numpy as np
import pytest

from nsbench import LCS, Case, solvers


def switched(rate, jump):
    """x' = rate (u(t) - x), u = 1 before the jump and -1 from then on; a diode that never acts."""

    def u(xp):
        return lambda t: rate * xp.array([xp.where(t < jump, 1.0, -1.0)])

    def q(xp):
        return lambda t: xp.array([1.0 + 0.0 * t])

    one = np.ones((1, 1))
    problem = LCS(-rate * one, 0.0 * one, 0.0 * one, one, u=u, q=q)
    return Case(name="jump", problem=problem, x0=np.array([0.5]), t=np.linspace(0.0, 1.0, 6))


@pytest.mark.long
@pytest.mark.parametrize("rate", (1.0, 300.0))
def test_a_jump_of_an_input_is_found_wherever_it_lies(rate):
    missed = []
    for jump in np.random.default_rng(0).uniform(0.05, 0.95, 40):
        case = switched(rate, jump)
        run = solvers.solve(case, "event_driven", tol=1e-12)
        t = case.t
        assert run.status.ok
        at = 1.0 - 0.5 * np.exp(-rate * jump)
        exact = np.where(
            t < jump,
            1.0 - 0.5 * np.exp(-rate * t),
            -1.0 + (at + 1.0) * np.exp(-rate * np.maximum(t - jump, 0.0)),
        )
        missed.append(np.abs(run.x[:, 0] - exact).max())
    assert max(missed) < 1e-11


def test_steps_of_other_integrators_are_counted():
    """Each step of the walk takes them many: a budget of steps is one of theirs."""
    case = switched(1.0, 0.5)
    run = solvers.solve(case, "event_driven[method=rk45]", tol=1e-11)
    assert run.status.ok and run.stats["steps"] > 100
    assert (
        solvers.solve(case, "event_driven[method=rk45,max_steps=100]", tol=1e-11).status.code
        == "maxiter"
    )


def _free(u, t, rate=1.0):
    """x' = u(t) - rate x beside a diode that never acts."""
    one = np.ones((1, 1))
    problem = LCS(
        -rate * one,
        0.0 * one,
        0.0 * one,
        one,
        u=u,
        q=lambda xp: lambda t: xp.array([1.0 + 0.0 * t]),
    )
    return Case(name="free", problem=problem, x0=np.array([0.5]), t=t)


@pytest.mark.parametrize("width", (0.02, 0.1))
def test_a_pulse_that_samples_lie_in_is_found_between_the_nodes_of_a_step(width):
    case = _free(
        lambda xp: (
            lambda t: xp.array([xp.where((t > 0.305) & (t < 0.305 + width), 1.0 / width, 0.0)])
        ),
        np.linspace(0.0, 1.0, 101),
    )
    run = solvers.solve(case, "event_driven", tol=1e-12)
    t = case.t
    begun = np.clip(t - 0.305, 0.0, None)
    ended = np.clip(t - 0.305 - width, 0.0, None)
    exact = 0.5 * np.exp(-t) + (np.exp(-ended) - np.exp(-begun)) / width
    assert run.status.ok and np.abs(run.x[:, 0] - exact).max() < 1e-11


@pytest.mark.parametrize("row", (0, 1))
def test_a_pulse_in_the_input_of_an_open_row_is_found(row):
    """w = 1 + q falls below zero within the pulse, in which lam = 1 acts on x' = lam - x."""
    one = np.ones((1, 1))
    pulse = (0.305, 0.325)
    q = lambda xp: lambda t: xp.array([xp.where((t > pulse[0]) & (t < pulse[1]), -1.0, 1.0)])
    case = Case(
        name="row",
        problem=LCS(-one, one, 0.0 * one, one, q=q),
        x0=np.array([0.5]),
        t=np.linspace(0.0, 1.0, 101 if row else 201),
    )
    run = solvers.solve(case, "event_driven", tol=1e-12)
    t = case.t
    begun = np.clip(t - pulse[0], 0.0, None)
    ended = np.clip(t - pulse[1], 0.0, None)
    assert run.status.ok and [e.kind for e in run.events] == ["contact", "release"]
    assert np.abs(run.x[:, 0] - 0.5 * np.exp(-t) - np.exp(-ended) + np.exp(-begun)).max() < 1e-11


@pytest.mark.parametrize("rate, w, begin", ((1e8, 100.0, 10.0), (1e12, 10.0, 100.0)))
def test_roundings_of_a_fast_input_are_no_jumps_for_a_stiff_mode(rate, w, begin):
    case = _free(
        lambda xp: lambda t: rate * xp.array([2.0 + xp.sin(w * t)]),
        np.linspace(begin, begin + 1.0, 11),
        rate,
    )
    run = solvers.solve(case, "event_driven")
    assert run.status.ok and run.stats["steps"] < 1000
    assert run.x[1:, 0] == pytest.approx(2.0 + np.sin(w * case.t[1:]), abs=2.0 * w / rate + 1e-11)


@pytest.mark.parametrize("rate, w, tol", ((2.0, 5.0, 1e-6), (2.0, 5.0, 1e-8), (1.0, 3.0, 1e-8)))
def test_a_mode_that_grows_takes_the_steps_at_which_an_implicit_one_has_no_solution(rate, w, tol):
    """x' = rate x + cos(w t): steps of 1 / rate are tried."""
    case = _free(lambda xp: lambda t: xp.array([xp.cos(w * t)]), np.linspace(0.0, 1.0, 5), -rate)
    run = solvers.solve(case, "event_driven", tol=tol)
    t = case.t
    size = rate * rate + w * w
    exact = (
        np.exp(rate * t) * (0.5 + rate / size) + (w * np.sin(w * t) - rate * np.cos(w * t)) / size
    )
    assert run.status.ok and np.abs(run.x[:, 0] - exact).max() < 10.0 * tol


def test_a_jump_is_as_well_known_as_the_clock_however_late():
    begin = 1e4
    missed = []
    for jump in np.random.default_rng(0).uniform(0.1, 0.9, 12):
        u = lambda xp, at=begin + jump: lambda t: xp.array([xp.where(t < at, 1.0, -1.0)])
        case = _free(u, np.linspace(begin, begin + 1.0, 5))
        run = solvers.solve(case, "event_driven", tol=1e-12)
        after = case.t - begin
        at = 1.0 - 0.5 * np.exp(-jump)
        exact = np.where(
            after < jump,
            1.0 - 0.5 * np.exp(-after),
            -1.0 + (at + 1.0) * np.exp(-np.maximum(after - jump, 0.0)),
        )
        missed.append(np.abs(run.x[:, 0] - exact).max())
    assert max(missed) < 4.0 * np.spacing(begin)


def test_a_step_is_no_shorter_than_the_clock_knows():
    """At 1e5 a part of 1e-13 of the run is half of what the clock ticks: such a step ends where it
    began."""
    begin = 1e5
    jump = 0.3
    u = lambda xp: lambda t: xp.array([xp.where(t < begin + jump, 1.0, -1.0)])
    case = _free(u, np.linspace(begin, begin + 1.0, 5))
    run = solvers.solve(case, "event_driven[max_steps=3000]", tol=1e-12)
    after = case.t - begin
    at = 1.0 - 0.5 * np.exp(-jump)
    exact = np.where(
        after < jump,
        1.0 - 0.5 * np.exp(-after),
        -1.0 + (at + 1.0) * np.exp(-np.maximum(after - jump, 0.0)),
    )
    assert run.status.ok and np.abs(run.x[:, 0] - exact).max() < 4.0 * np.spacing(begin)
