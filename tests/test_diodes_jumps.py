"""Linear complementarity systems whose inputs jump: the jump is found wherever it lies in a step."""
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


@pytest.mark.parametrize("rate", (1.0, 300.0))
def test_a_jump_of_an_input_is_found_wherever_it_lies(rate):
    missed = []
    for jump in np.random.default_rng(0).uniform(0.05, 0.95, 150):
        case = switched(rate, jump)
        run, t = solvers.solve(case, "event_driven", tol=1e-12), case.t
        assert run.status.ok
        at = 1.0 - 0.5 * np.exp(-rate * jump)
        exact = np.where(t < jump, 1.0 - 0.5 * np.exp(-rate * t),
                         -1.0 + (at + 1.0) * np.exp(-rate * np.maximum(t - jump, 0.0)))
        missed.append(np.abs(run.x[:, 0] - exact).max())
    assert max(missed) < 1e-11


def test_steps_of_other_integrators_are_counted():
    """Each step of the walk takes them many: a budget of steps is one of theirs."""
    case = switched(1.0, 0.5)
    run = solvers.solve(case, "event_driven[method=rk45]", tol=1e-11)
    assert run.status.ok and run.stats["steps"] > 100
    assert solvers.solve(case, "event_driven[method=rk45,max_steps=100]", tol=1e-11).status.code == "maxiter"
