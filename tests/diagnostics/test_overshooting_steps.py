"""Steps too long for a scene: they overshoot between walls, or press particles into one another."""

import numpy as np
import pytest

import nsbench
from nsbench import Affine, Case, Complementarity, Distance, get_case


def stiff(rate, **changes):
    """x is drawn to sin t at this rate, y comes and goes above a floor."""

    def drift(xp):
        def f(t, x):
            return xp.array([-rate * (x[0] - xp.sin(t)), 0.0 * x[1] - xp.cos(3.0 * t)])

        return f

    walls = Affine(A=np.eye(2), b=np.array([2.0, 0.3]))
    t = np.linspace(0.0, 2.0, 21)
    case = Case("stiff", Complementarity(drift, (walls,)), x0=np.zeros(2), t=t)
    return case.replace(**changes)


@pytest.mark.parametrize("method", ["pbd", "catching_up"])
def test_steps_beyond_the_stability_limit_are_doubted(method):
    for rate in (1e4, 1e6):
        traj = nsbench.solve(stiff(rate), method, h=1e-2)
        assert traj.status.check == "step_instability"
        assert "overshoot" in traj.status.why
    assert nsbench.solve(stiff(1e2), method, h=1e-2).status.ok
    assert nsbench.solve(stiff(1e3), method, h=1.9e-3).status.ok


@pytest.mark.parametrize("method", ["pbd", "catching_up"])
def test_a_state_that_a_wall_holds_is_not_doubted(method):
    """The same rate, drawn to a place behind a wall: it rests there, whatever the step."""
    walls = Affine(A=np.eye(2), b=np.array([-0.1, 0.3]))
    problem = stiff(1e4).problem
    case = stiff(1e4, problem=Complementarity(problem.drift, (walls,)), x0=np.array([0.1, 0.0]))
    case = case.replace(t=np.linspace(3.2, 6.2, 31))  # sin t < 0.1
    assert nsbench.solve(case, method, h=1e-2).status.ok


def test_discs_that_overlap_by_more_than_half_are_doubted():
    """Loads of a column press discs into one another if steps, or springs, are too coarse."""
    case = get_case("stack", n=10).replace(t=np.linspace(0.0, 8.0, 5))
    traj = nsbench.solve(case, "pbd", h=0.5)
    assert traj.status.check == "deep_overlap" and "too long" in traj.status.why
    assert nsbench.solve(case, "pbd", h=0.02).status.ok
    assert nsbench.solve(case, "catching_up", h=0.5).status.ok


def test_discs_may_overlap_as_they_do_at_the_start():
    """Springs part discs of distance 2 slowly: they overlap as deep as at the start for long."""

    def drift(xp):
        return lambda t, x: 0.0 * x

    pair = Distance(start=0, dim=2, radii=np.ones(2))
    x0 = np.array([0.0, 0.0, 0.8, 0.0])
    problem = Complementarity(drift, (pair,))
    case = Case("pair", problem, x0=x0, t=np.linspace(0.0, 0.05, 5), start="keep")
    traj = nsbench.solve(case, "penalty", k=1.0)
    assert np.linalg.norm(traj.x[-1, 2:] - traj.x[-1, :2]) < 1.0
    assert traj.status.ok
