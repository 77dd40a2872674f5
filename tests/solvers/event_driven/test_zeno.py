"""A Zeno point ends an event-driven run with its time, and costs implicit Euler half an order for a
while."""

import numpy as np
import pytest

from nsbench import Case, Filippov, errors, fit_order, get_case, solve
from nsbench.study.plan import substeps_ladder

IMPLICIT = "euler[implicit=true]"


def states(xp):
    return lambda t, x: x + 0.0


def still(xp):
    return lambda t, x: 0.0 * x


def fate(B, x):
    """What becomes of x' = B sgn(x) from x, and when: written out from axis to axis."""
    t = 0.0
    s = np.sign(x)
    for _ in range(20_000):
        v = B @ s
        left = np.where(x * v < 0, -x / np.where(v == 0, 1, v), np.inf)
        i = int(np.argmin(left))
        if not np.isfinite(left[i]):
            return "never", np.inf
        t = t + left[i]
        x = x + left[i] * v
        s[i] = -s[i]
        if (B @ s)[i] * s[i] <= 0.0:
            return "slides", t
        x[i] = 1e-300 * s[i]
        if np.abs(x).max() < 1e-14:
            return "ends", t
    return "slow", t


@pytest.mark.survives("zeno")
@pytest.mark.parametrize("seed", range(12))
def test_random_spirals_end_at_their_accumulation_time(seed):
    rng = np.random.default_rng(seed)
    a = rng.uniform(0.1, 0.8, 2)
    w = rng.uniform(0.5, 2.0, 2)
    B = np.array([[-a[0], -w[0]], [w[1], -a[1]]])
    x0 = rng.uniform(-1, 1, 2)
    what, end = fate(B, x0.copy())
    traj = solve(
        Case("z", Filippov.relay(still, B, states), x0, np.linspace(0.0, 1.3 * end + 0.1, 31))
    )
    if what == "slides":
        assert traj.status.ok and "accumulation" not in traj.stats
        return
    assert (
        what == "ends"
        and traj.status.code == "chatter"
        and f"t = {traj.stats['accumulation']:.9g}" in str(traj.status)
    )
    assert abs(traj.stats["accumulation"] - end) < 1e-8
    assert np.all(np.isfinite(traj.x) == (traj.t < end)[:, None])


def ladder(case, octaves, points):
    spacing = np.diff(case.t).min()
    runs = [solve(case, IMPLICIT, h=spacing / n) for n in substeps_ladder(2, octaves, points)]
    return np.array([r.stats["h"] for r in runs]), np.array(
        [errors(case, r)["state_sup"] for r in runs]
    )


@pytest.mark.long
def test_implicit_steps_pass_the_zeno_point_with_order_one_half_over_six_octaves():
    h, err = ladder(get_case("spiral"), 6, 25)
    assert h[0] / h[-1] >= 64 and 0.4 < np.polyfit(np.log(h), np.log(err), 1)[0] < 0.6
    # that it is a local order, the estimator of the limit leaves open
    low, high = fit_order(h, err).interval
    assert low < 0.5 < high


def test_the_half_is_a_logarithm():
    # err = h/a log(1 + a/h) from h = a/2 to a/500, where the local order has long passed one half
    a = 0.1
    h, err = ladder(get_case("spiral"), 9, 13)
    model = h / a * np.log1p(a / h)
    assert np.all(np.abs(np.log(err / model))[h < a / 2] < 0.5)


@pytest.mark.long
def test_at_rest_in_the_point_the_weights_are_one_half():
    case = get_case("spiral", a=0.5)
    traj = solve(case, IMPLICIT, h=0.01)
    gone = case.t > 1.4
    assert traj.status.ok and np.abs(traj.x[gone]).max() < 1e-14
    np.testing.assert_allclose(
        np.diff(traj.impulse[gone], axis=0) / np.diff(case.t)[0], 0.5, atol=1e-12
    )


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("ratio", [0.5, 0.93, 1.0, 1.1])
def test_the_compiled_loop_tells_accumulating_events_as_the_loop_in_python_does(scale, ratio):
    """Intervals that shrink by `ratio` after each event, in a run of length `scale`."""
    from nsbench.solvers.event_driven.accumulation import WINDOW, accumulation
    from nsbench.solvers.event_driven.filippov.kernels.mode_change import events_accumulate

    told = []
    for first in scale * 10.0 ** np.arange(-12.0, 1.0):
        times = np.concatenate(([0.0], np.cumsum(first * ratio ** np.arange(2.0 * WINDOW))))
        told.append(accumulation(times, scale) is not None)
        assert events_accumulate.py_func(times, len(times), scale) == told[-1], first
    assert any(told) == (ratio**WINDOW < 0.9) and not all(told)
