"""Runs to a tolerance: kept, at little more than the fewest steps, by estimates that a second run
confirms."""

import dataclasses

import numpy as np
import pytest

import nsbench
from nsbench import get_case
from nsbench.error_bars import Bars, error_bars
from nsbench.error_bars.entry import LINEARISED
from nsbench.reference import reference
from nsbench.solvers import get
from nsbench.solvers.common import tolerance_run
from nsbench.solvers.common.tolerance_run import SAFETY, next_steps, whole_steps
from nsbench.study.plan import plan_runs


def error_of(case, traj):
    """(k,) |x - x*| at the samples, in the 2-norm."""
    return np.linalg.norm(traj.x - reference(case).x, axis=1)


@pytest.mark.parametrize("method", ["pbd", "catching_up"])
@pytest.mark.parametrize("name", ["tide", "rods[n=5]", "three_discs"])
def test_a_tolerance_is_kept(name, method):
    case = get_case(name)
    traj = nsbench.solve(case, f"{method}[tol=1e-3]", tol=5e-3)
    assert traj.status.ok
    assert error_of(case, traj).max() <= 5e-3
    assert traj.bound.state.max() <= 5e-3
    assert error_of(case, traj).max() >= 5e-4  # and not by far too many steps


@pytest.mark.parametrize("name", ["tide", "hex", "discs[n=3]", "obstacle"])
def test_a_tolerance_costs_at_most_twice_the_best_equal_steps(name):
    case = get_case(name)
    traj = nsbench.solve(case, "pbd[tol=1e-2]")
    spacing = np.diff(case.t)
    each = traj.stats["steps"] // (2 * len(spacing))
    half = nsbench.solve(case, "pbd", h=spacing.max() / each)
    assert error_of(case, half).max() > 1e-2


def test_steps_that_are_too_long_for_a_sound_run_are_shortened():
    """A column of discs passes through itself in a step as long as a disc is high."""
    case = get_case("stack", n=10).replace(t=np.linspace(0.0, 40.0, 9))
    run = get("pbd[tol=1e-1]").prepare_tolerance(case, 0.1)
    assert nsbench.solve(case, "pbd", h=run.first[0]).status.code == "degenerate"
    traj = run()
    assert traj.status.ok and traj.bound.state.max() <= 0.1
    assert np.abs(traj.x - case.x0).max() <= 0.1  # it rests


def test_a_run_that_no_step_makes_sound_ends_as_such(monkeypatch):
    monkeypatch.setattr(tolerance_run, "SOUGHT_STEPS", 300)
    case = get_case("stack", n=10).replace(t=np.linspace(0.0, 40.0, 9))
    traj = nsbench.solve(case, "pbd[tol=1e-2]")
    assert traj.status.code in tolerance_run.TOO_LONG
    assert 1 < traj.stats["passes"] < 6 and traj.stats["steps"] <= 4 * 300


def test_the_first_pass_has_the_steps_that_it_asks_for():
    """A sample interval has a whole number: longer steps than are taken foretell nothing."""
    case = get_case("tide").replace(t=np.linspace(0.0, 3.0, 13))
    run = get("pbd[tol=1e-2]").prepare_tolerance(case, 1e-2)
    parts = np.diff(case.t) / run.first
    assert np.allclose(parts, np.round(parts)) and parts.max() == 2.0
    assert np.array_equal(whole_steps(np.diff(case.t), run.first), run.first)


@pytest.mark.parametrize("share", [0.45, 0.17])
def test_errors_that_are_proportional_to_the_steps_are_foretold(share):
    """For an error that each step adds to alike, the next pass takes the fewest equal steps."""
    spacing = np.full(10, 0.1)
    h = spacing / 3.0
    grown = np.linspace(0.0, 1.0, 11)
    bars = Bars(np.linspace(0.0, 1.0, 11), grown, grown, grown, gained=np.full(10, 0.1))
    bars = dataclasses.replace(bars, distance=np.zeros(11))
    steps = spacing / next_steps(h, spacing, bars, share)
    assert np.allclose(steps, np.ceil(3.0 / (SAFETY * share)))


def estimated(vector, allowance=LINEARISED):
    """An estimate whose error is thought to be vector (k, 1)."""
    size = np.abs(vector[:, 0])
    t = np.arange(float(len(size)))
    return Bars(t, allowance * size, size, size, vector=vector, unallowed=size)


@pytest.mark.parametrize("part", [1.0, 0.9, 1.2, 0.3])
def test_the_allowance_is_what_the_change_between_two_runs_shows_to_be_missed(part):
    """Errors 2 e and e of two runs, of which estimates know a part."""
    e = np.linspace(0.0, 0.1, 6)[:, None]
    true = np.ones((6, 1))
    bars = estimated(part * e).confirmed(true + e, estimated(2.0 * part * e), true + 2.0 * e)
    share = min(abs(part - 1.0), LINEARISED - 1.0)
    assert np.allclose(bars.state, (1.0 + share) * part * e[:, 0])
    if abs(part - 1.0) < LINEARISED - 1.0:
        assert np.all(bars.state >= (1.0 - share**2) * e[:, 0] * (1.0 - 1e-12))


def test_nothing_confirms_an_estimate_but_a_run_that_moved_and_has_one():
    e = np.linspace(0.0, 0.1, 6)[:, None]
    bars = estimated(e)
    assert np.array_equal(bars.confirmed(e, bars, e).state, bars.state)
    none = Bars.none(bars.t, "none")
    assert bars.confirmed(e, none, 2.0 * e) is bars
    assert none.confirmed(e, bars, 2.0 * e) is none


@pytest.mark.parametrize("name", ["discs[n=3]", "hex", "obstacle", "chain"])
def test_a_confirmed_estimate_is_above_the_error_and_nearer_to_it(name):
    case = get_case(name)
    spacing = np.diff(case.t).min()
    runs = [nsbench.solve(case, "pbd", h=spacing / k) for k in (6, 12)]
    long, short = (error_bars(case, traj).made for traj in runs)
    confirmed = short.confirmed(runs[1].x, long, runs[0].x)
    error = error_of(case, runs[1]).max()
    assert error <= confirmed.state.max() <= short.state.max() and short.vector.size
    assert confirmed.state.max() < 0.95 * short.state.max()


@pytest.mark.parametrize("name, method", [("discs[n=10]", "catching_up"), ("bean", "pbd")])
def test_errors_are_carried_through_intervals_in_which_contacts_close_and_open(name, method):
    """Loaded contacts are curved there as anywhere: they drive neighbouring motions apart."""
    case = get_case(name)
    traj = nsbench.solve(case, method, h=np.diff(case.t).min() / 4)
    apart = traj.x - reference(case).x
    missed = np.linalg.norm(error_bars(case, traj).made.vector - apart, axis=1).max()
    assert missed < 0.15 * np.linalg.norm(apart, axis=1).max()


def test_the_vector_of_an_estimate_has_the_units_of_the_state():
    case = get_case("two_discs")
    traj = nsbench.solve(case, "pbd", h=0.05)
    bars = error_bars(case, traj).made
    apart = traj.x - reference(case).x
    assert np.abs(bars.vector - apart).max() < 0.05 * np.abs(apart).max()
    assert np.allclose(bars.unallowed, np.linalg.norm(bars.vector, axis=1), rtol=0.05, atol=1e-6)


def test_a_study_of_a_method_with_a_tolerance_in_its_name_runs_that_tolerance():
    specs = plan_runs([("tide", "")], ["pbd[tol=1e-2]"])
    assert [(s.accuracy, s.asked) for s in specs] == [("tol", 1e-2)]
    specs = plan_runs([("tide", "")], ["pbd[tol=1e-2]"], values={"tol": [0.1, 0.03]})
    assert [s.asked for s in specs] == [0.1, 0.03]
