"""Explicit steps that overshoot between walls: the state does not grow for long, walls catch it."""

import numpy as np
import pytest

import nsbench
from nsbench import Affine, Case, Complementarity


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
