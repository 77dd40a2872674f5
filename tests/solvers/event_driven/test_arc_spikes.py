"""A spike of a drift or a wall, narrower than any step, is found; where nothing can be proven the
run says so."""

import numpy as np
import pytest

from nsbench import Affine, Case, Complementarity, Smooth
from nsbench.solvers import solve
from nsbench.solvers.event_driven.smooth.arc import integrate_to_event

SQRT_PI = np.pi**0.5


def run(drift, *constraints, x0=(1.0,), T=10.0, k=3, method="event_driven", **options):
    case = Case(
        name="spike",
        problem=Complementarity(drift, constraints),
        x0=np.array(x0),
        t=np.linspace(0.0, T, k),
    )
    return solve(case, method, **options)


@pytest.mark.parametrize("method", ["event_driven", "event_driven[compiled=false]"])
@pytest.mark.parametrize("width", [0.3, 5e-3, 1e-3, 3e-4, 1e-4])
def test_a_spike_of_the_drift_moves_the_state_by_its_area(width, method):
    """x' = cos t + exp(-((t - c) / w)^2), c off every sample: one step is a thousand widths and
    more."""
    c = 3.21
    traj = run(
        lambda xp: lambda t, x: (xp.cos(t) + xp.exp(-(((t - c) / width) ** 2))) * xp.ones_like(x),
        method=method,
    )
    assert traj.status.ok and traj.stats["roots"] == "verified"
    assert (traj.stats["loop"] == "compiled") == (method == "event_driven")
    assert traj.stats["loop"] == "compiled" or traj.stats["refused"] >= (width < 2e-3)
    assert abs(traj.x[-1, 0] - 1.0 - np.sin(10.0) - width * SQRT_PI) < 1e-11


@pytest.mark.parametrize("width", [1e-2, 1e-3, 1e-4])
def test_a_spike_in_space_is_met(width):
    """x' = 1 / (1 + exp(-((x - c) / w)^2)): the time lost in the spike is its area."""
    traj = run(lambda xp: lambda t, x: 1.0 / (1.0 + xp.exp(-(((x - 4.4) / width) ** 2))), x0=(0.0,))
    assert traj.status.ok and abs(traj.x[-1, 0] - 10.0 + width * SQRT_PI) < 1e-11


@pytest.mark.parametrize("width", [1e-2, 1e-3, 1e-4, 3e-5])
def test_a_spike_of_a_wall_lifts_what_stands_below_it(width):
    """The wall exp(-((t - c) / w)^2) meets a point at rest at 1/2, lifts it to 1 and is gone."""
    wall = Affine([[1.0]], lambda xp: lambda t: -xp.exp(-(((t - 7.3) / width) ** 2)) * xp.ones(1))
    traj = run(lambda xp: lambda t, x: 0.0 * x, wall, x0=(0.5,), k=2)
    assert [e.kind for e in traj.events] == ["contact", "release"]
    assert traj.stats["roots"] == "verified" or width < 1e-4, (
        "below, rounding of the time leaves the proof open"
    )
    np.testing.assert_allclose(
        [e.t for e in traj.events], [7.3 - width * np.log(2) ** 0.5, 7.3], atol=1e-9
    )
    rounding = 2e-15 / width  # of the time, seen at the speed of the wall
    assert (
        abs(traj.x[-1, 0] - 1.0) < 1e-12 + rounding
        and abs(traj.impulse[-1, 0] - 0.5) < 1e-12 + rounding
    )


def test_a_spike_of_a_smooth_constraint_is_seen():
    wall = Smooth(lambda xp: lambda t, x: x[:1] - xp.exp(-(((x[1:] - 2.2) / 1e-3) ** 2)))
    traj = run(
        lambda xp: lambda t, x: xp.stack((0.0 * x[0], 1.0 + 0.0 * x[1])),
        wall,
        x0=(0.5, 0.0),
        T=4.0,
        k=2,
    )
    assert traj.events and traj.events[0].kind == "contact" and traj.stats["roots"] == "verified"
    assert abs(traj.events[0].t - (2.2 - 1e-3 * np.log(2) ** 0.5)) < 1e-9


def test_a_drift_that_branches_is_sampled_and_the_run_says_so():
    def drift(xp):
        def f(t, x):
            return -x if float(t) < 20.0 else x

        return f

    traj = run(drift)
    assert traj.status.ok and traj.stats["roots"] == "sampled" and traj.stats["unproven"] > 0
    assert traj.stats["steps"] >= 64, "where nothing is proven steps are bounded"
    assert abs(traj.x[-1, 0] - np.exp(-10.0)) < 1e-12


def test_kinks_are_followed_and_proven():
    traj = run(lambda xp: lambda t, x: abs(xp.sin(3.0 * t)) * xp.ones_like(x), x0=(0.0,), T=2.0)
    whole, rest = divmod(6.0, np.pi)
    assert (
        abs(traj.x[-1, 0] - (2 * whole + 1 - np.cos(rest)) / 3) < 1e-13
        and traj.stats["unproven"] == 0
    )


def test_jumps_of_the_drift_are_followed():
    """x' = -1 to t = 1, then +1: the floor is left at once; the multiplier jumps from 1 to
    nothing."""
    traj = run(
        lambda xp: lambda t, x: xp.where(t < 1.0, -1.0, 1.0) * xp.ones_like(x),
        Affine([[1.0]], [0.0]),
        x0=(0.5,),
        T=2.0,
    )
    assert [e.kind for e in traj.events] == ["contact", "release"] and abs(
        traj.events[1].t - 1.0
    ) < 1e-12
    assert abs(traj.x[-1, 0] - 1.0) < 1e-11 and abs(traj.impulse[-1, 0] - 0.5) < 1e-11


def test_without_data_nothing_is_proven_but_much_is_seen():
    """Spikes down to 1/500 of the run, by the equation at interior points alone."""
    rng = np.random.default_rng(1)
    for c in rng.uniform(1.0, 9.0, 20):
        arc = integrate_to_event(
            lambda t, y, c=c: np.array([1.0 + np.exp(-(((t - c) / 2e-2) ** 2))]),
            0.0,
            np.zeros(1),
            10.0,
        )
        assert arc.unproven > 0 and abs(arc.y[0] - 10.0 - 2e-2 * SQRT_PI) < 1e-10
