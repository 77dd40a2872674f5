"""Runs that cannot go on end with a status and a sentence; bad starts and options are refused."""

import numpy as np
import pytest
from event_scenes import floor, push, relays, scene

from nsbench import Affine, Smooth
from nsbench.solvers import solve


def test_a_start_outside_is_refused_or_projected():
    case = scene(push(-1.0), floor(), x0=[-1.0], t=[0, 1])
    with pytest.raises(ValueError, match="violates"):
        solve(case)
    assert solve(case.replace(start="project")).x[:, 0] == pytest.approx([0.0, 0.0], abs=1e-12)
    assert solve(case.replace(start="keep")).status.code == "refused"


MOVING = Affine(np.array([[1.0], [-1.0]]), lambda xp: lambda t: xp.stack((-t, 2 - t)))
FAILURES = {
    "nan at the start": (lambda xp: lambda t, x: x * np.nan, floor(), [1.0], "nan"),
    "nan later": (lambda xp: lambda t, x: -xp.sqrt(2 - t) * xp.ones_like(x), floor(), [1.0], "nan"),
    "blow-up": (lambda xp: lambda t, x: x**2, floor(), [1.0], "diverged"),
    "walls that close": (push(0.0), MOVING, [0.5], "infeasible"),
    "no gradient": (
        push(-1.0),
        Smooth(
            lambda xp: lambda t, x: x**3,
            lambda xp: lambda t, x: np.diag(3 * x**2),
            lambda xp: lambda t, x: 0 * x,
        ),
        [1.0],
        "degenerate",
    ),
    "no direction": (
        push(-1.0),
        Smooth(
            lambda xp: lambda t, x: 1 * x,
            lambda xp: lambda t, x: np.diag(np.where(x > 1e-6, 1.0, np.nan)),
            lambda xp: lambda t, x: 0 * x,
        ),
        [1.0],
        "degenerate",
    ),
}


@pytest.mark.long
@pytest.mark.parametrize("name", FAILURES)
def test_failures_are_statuses(name):
    drift, constraint, x0, code = FAILURES[name]
    traj = solve(scene(drift, constraint, x0=x0, t=np.linspace(0, 4, 9)))
    assert traj.status.code == code and str(traj.status).endswith(".")
    assert (
        np.isnan(traj.x[-1]).all()
        and np.isnan(traj.impulse[-1]).all()
        and np.isfinite(traj.x[0]).all()
    )


@pytest.mark.parametrize("option, code", [("max_events=1", "chatter"), ("max_steps=3", "maxiter")])
def test_budgets_end_a_run(option, code):
    assert solve("tide", f"event_driven[{option}]").status.code == code


def test_bad_options_are_named():
    for spec in (
        "event_driven[method=euler]",
        "event_driven[max_events=0]",
        "event_driven[max_step=-1]",
    ):
        with pytest.raises(ValueError, match=spec.partition("[")[2].partition("=")[0]):
            solve("tide", spec)


@pytest.mark.long
@pytest.mark.parametrize("at", [1.373, 2 / 3, 1.37, 2.1, 2.6])
@pytest.mark.parametrize("tol", [1e-6, 1e-10])
def test_what_is_held_is_let_go_where_the_drift_jumps(at, tol):
    """A multiplier, or the weight of a field, that jumps has no root: what it ends begins with the
    first time behind."""

    def jumps(xp):
        return lambda t, x: xp.where(t < at, -1.0, 2.0) + 0.0 * x

    def against(xp):
        return lambda t, x, s: xp.where(t < at, 0.0, 3.0) - s + 0.0 * x

    t = np.linspace(0, 3, 61)
    way = 2.0 * (3.0 - at)
    floored = solve(scene(jumps, floor(), x0=[0.5], t=t), tol=tol)
    slid = solve(relays(against, lambda xp: lambda t, x: x, [0.5], t), tol=tol)
    for traj in floored, slid:
        assert traj.status.ok and traj.x[-1, 0] == pytest.approx(way, abs=10 * tol)
    assert [e.t for e in floored.events] == pytest.approx([0.5, at], abs=1e-14)


@pytest.mark.parametrize("held", [0, 1, 2])
@pytest.mark.parametrize("spec", ["event_driven", "event_driven[method=rk45]"])
def test_impulses_stay_when_the_last_event_is_at_the_very_end(spec, held):
    """Walls that are reached at 0.25 and 1 (as many as `held`), and one at T = 2."""
    x0, drift = np.array([[0.125, 1.0, 2.0], [-0.5, -1.0, -1.0]])[:, 2 - held :]
    walls = Affine(A=np.eye(held + 1), b=np.zeros(held + 1))
    case = scene(push(*drift), walls, x0=x0, t=np.linspace(0.0, 2.0, 9))
    run = solve(case, spec)
    assert run.status.ok, run.status
    known = dict(zip(run.contacts, run.impulse[-1], strict=True))
    found = [known.get((0, i), 0.0) for i in range(held + 1)]
    assert found == pytest.approx([0.875, 1.0, 0.0][2 - held :], abs=1e-12)
