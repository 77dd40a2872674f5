"""Event-driven runs of Filippov systems say so where no single motion goes on."""

import numpy as np
import pytest
from filippov_factories import constant, drift, states, still
from filippov_runs import filippov, run, second

from nsbench import Filippov
from nsbench.solvers.event_driven.accumulation import accumulation


def cross_times(B, x, count):
    """Crossing times of x' = B sgn(x) by going from axis to axis."""
    t = 0.0
    s = np.sign(x)
    times = []
    for _ in range(count):
        v = B @ s
        left = np.where(x * v < 0, -x / np.where(v == 0, 1, v), np.inf)
        i = int(np.argmin(left))
        t = t + left[i]
        x = x + left[i] * v
        x[i] = 0.0
        s[i] = -s[i]
        x[i] = 1e-300 * s[i]
        times.append(t)
    return times


@pytest.mark.survives("zeno")
@pytest.mark.parametrize("damping", [0.05, 0.2, 0.9])
def test_a_spiral_stops_as_chatter_at_its_accumulation_time(damping):
    B = np.array([[-damping, -1.0], [1.0, -damping]])
    traj = run(filippov(Filippov.relay(still, B, states), (1.0, 0.3), 40.0))
    end = cross_times(B, np.array([1.0, 0.3]), 400)[-1]
    assert traj.status.code == "chatter"
    assert f"{end:.6g}" in str(traj.status)
    assert np.all(np.isfinite(traj.x[traj.t < end - 1e-6])) and np.all(
        np.isnan(traj.x[traj.t > end])
    )


def test_accumulation_is_not_seen_in_slow_damping():
    assert accumulation(list(np.cumsum(0.5 ** np.arange(60))), 1.0) == pytest.approx(2.0, abs=1e-12)
    assert accumulation(list(np.cumsum(0.5 ** np.arange(12))), 1.0) is None
    assert accumulation(list(np.log(1 + np.arange(1000))), 1.0) is None
    assert accumulation([1.0] * 7, 1.0) == 1.0


UP = constant(1.0, 1.0)
DOWN = constant(1.0, -1.0)
DOWN_LEFT = constant(-1.0, -1.0)
ENDS = {
    "repulsive start": (
        Filippov({(1,): UP, (-1,): DOWN}, second),
        (0.0, 0.0),
        "degenerate",
        "not unique",
    ),
    "repulsive entry": (
        Filippov({(1, 1): UP, (1, -1): DOWN, (-1, 1): DOWN, (-1, -1): UP}, states),
        (-1.0, 0.3),
        "degenerate",
        "t = 1 several motions continue from surfaces 0, 1",
    ),
    "both tangential": (
        Filippov({(1,): constant(1.0, 0.0), (-1,): constant(2.0, 0.0)}, second),
        (0.0, 0.0),
        "degenerate",
        "not unique",
    ),
    "nan": (
        Filippov(
            {(1,): drift(lambda xp, t, x: xp.array([1.0, -1 + 0 * xp.log(0.5 - x[0])])), (-1,): UP},
            second,
        ),
        (0.0, 1.0),
        "nan",
        "not finite",
    ),
    "nan on the surface": (
        Filippov({(1,): DOWN, (-1,): constant(np.nan, np.nan)}, second),
        (0.0, 1.0),
        "nan",
        "not finite on surface 0 at t = 1",
    ),
    "nan at the start": (
        Filippov({(1,): constant(np.nan, 0.0), (-1,): UP}, second),
        (0.0, 1.0),
        "nan",
        "t = 0",
    ),
    "blow-up": (
        Filippov({(1,): drift(lambda xp, t, x: x * x), (-1,): UP}, second),
        (1.0, 1.0),
        "diverged",
        "grew",
    ),
}


@pytest.mark.parametrize("name", ENDS)
def test_what_cannot_be_followed_is_a_status_with_a_sentence(name):
    problem, x0, code, words = ENDS[name]
    case = filippov(problem, x0, 2.0)
    with np.errstate(all="ignore"):
        traj = run(case)
    assert traj.status.code == code and words in str(traj.status)
    assert (
        np.array_equal(traj.x[0], case.x0)
        and np.all(np.isnan(traj.x[-1]))
        and traj.x.shape == (41, 2)
    )


@pytest.mark.survives("zeno")
def test_budgets_of_events_and_steps():
    swing = Filippov.relay(
        drift(lambda xp, t, x: xp.array([x[1], 0.0])),
        np.array([[0.0], [-1.0]]),
        drift(lambda xp, t, x: x[0:1]),
    )
    case = filippov(swing, (1.0, 0.0), 40.0)
    assert run(case).status.ok
    traj = run(case, max_events=3)
    assert traj.status.code == "chatter" and "max_events" in str(traj.status)
    assert run(case, max_steps=5).status.code == "maxiter"


# parts of FLAT within which the fold is reached: a touch from below is known no better
@pytest.mark.parametrize("ahead", [-3.0, -1.0, -0.3, 0.0, 0.1, 0.5, 0.9, 2.0, 10.0])
@pytest.mark.parametrize("bend", [1e-2, 1.0, 30.0])
def test_a_fold_is_left_in_one_way_from_whatever_place_rounding_reaches_it(ahead, bend):
    """Sliding ends at x = 0, where the field below is tangential to y = 0; x' = -1 on both sides,
    y' = bend x below: y = -bend (t - x(0))^2 / 2 from there on."""
    start = ahead * 1e-7
    below = drift(lambda xp, t, x: xp.array([-1.0, bend * x[0]]))
    traj = run(filippov(Filippov({(1,): DOWN_LEFT, (-1,): below}, second), (start, 0.0), 1.0))
    assert traj.status.ok
    left = np.maximum(traj.t - max(start, 0.0), 0.0)
    exact = -0.5 * bend * left**2 + min(start, 0.0) * bend * left
    assert np.abs(traj.x[:, 1] - exact).max() <= 1e-10 * max(1.0, bend)
