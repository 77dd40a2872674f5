"""Arcs end at their first event, wherever it lies in a step, with the accuracy of the step."""

import numpy as np
import pytest

from nsbench.solvers.event_driven.smooth.arc import integrate_to_event
from nsbench.solvers.event_driven.smooth.integrators import INTEGRATORS, Integrator
from nsbench.solvers.event_driven.smooth.stall import STALL_STEPS, StallDetector


@pytest.mark.long
def test_no_narrow_dip_is_missed():
    """200 parabolas that dip below zero by 1e-3 to 1e-12 somewhere inside a step."""
    rng = np.random.default_rng(0)
    for depth, where in zip(
        10.0 ** rng.uniform(-12, -3, 200), rng.uniform(0.2, 1.8, 200), strict=True
    ):
        arc = integrate_to_event(
            lambda t, y, w=where: np.array([2 * (t - w)]),
            0.0,
            np.array([where**2 - depth]),
            2.0,
            lambda t, y: y,
            band=1e-14,
        )
        assert arc.fired.size == 1
        assert abs(arc.t - (where - np.sqrt(depth))) < 1e-14 / np.sqrt(depth) + 1e-12


def test_bumps_of_a_wall_are_seen_though_the_drift_is_constant():
    for width in (0.1, 0.01, 0.003):
        arc = integrate_to_event(
            lambda t, y: np.ones(1),
            0.0,
            np.zeros(1),
            3.0,
            lambda t, y, w=width: 0.5 - np.exp(-(((y - 1.2345) / w) ** 2)),
            samples=np.linspace(0, 3, 61)[1:],
        )
        assert arc.fired.size and arc.t == pytest.approx(
            1.2345 - width * np.sqrt(np.log(2)), abs=1e-13
        )


def test_the_first_crossing_of_a_wavy_wall_is_found_in_one_long_step():
    for waves in (7.0, 23.0, 61.0):
        wall = lambda y, w=waves: 1.0 - 0.3 * y - 0.5 * np.sin(w * y)
        arc = integrate_to_event(
            lambda t, y: np.ones(1),
            0.0,
            np.zeros(1),
            4.0,
            lambda t, y, g=wall: g(y),
            data=lambda t, y, g=wall: [g(y)],
        )
        scan = np.linspace(0, 4, 400_001)
        first = scan[np.argmax(wall(scan) < 0)]
        assert arc.fired.size and first - 1e-5 <= arc.t <= first and arc.steps < 20


@pytest.mark.parametrize(
    "method, tol, bound", [("dop853", 1e-6, 1e-6), ("rk45", 1e-8, 3e-8), ("radau", 1e-8, 3e-8)]
)
def test_events_carry_the_accuracy_of_the_step_not_of_the_dense_output(method, tol, bound):
    """A pendulum of period 2 pi: the dense output of these is 10 to 1000 times coarser than the
    step."""
    arc = integrate_to_event(
        lambda t, y: np.array([y[1], -y[0]]),
        0.0,
        np.array([0.0, 1.0]),
        10.0,
        lambda t, y: y[:1],
        method=method,
        rtol=tol,
        band=1e-14,
    )
    assert abs(arc.t - np.pi) < bound and abs(arc.y[0]) <= 1e-14, (
        "the event lies within the band that was asked for"
    )
    assert abs(arc.y[1] + 1.0) < bound


def test_steps_that_lead_nowhere_end_a_run():
    """LSODA goes on with steps below rounding: hundreds of thousands at one time, before a pole."""
    creeps = StallDetector(0.0, 1.0)
    assert not any(creeps(k, 1e-3 * k) for k in range(500))
    assert not any(
        creeps(500 + k, 0.6 - 2.0**-k / 10.0) for k in range(300)
    )  # halved steps end by themselves
    assert any(creeps(800 + k, 0.6) for k in range(2 * STALL_STEPS))


def test_an_integrator_of_ones_own_is_a_record_with_its_class(monkeypatch):
    """A class that scipy.integrate has no name for: here RK23 with a count of its steps."""
    from scipy.integrate import RK23

    class Counting(RK23):
        steps = 0

        def step(self):
            Counting.steps += 1
            return super().step()

    own = Integrator(lambda: Counting, defect=1e6, explicit=True)
    monkeypatch.setitem(INTEGRATORS, "own", own)
    arc = integrate_to_event(
        lambda t, y: np.array([y[1], -y[0]]),
        0.0,
        np.array([1.0, 0.0]),
        9.0,
        lambda t, y: y[:1],
        method="own",
        rtol=1e-8,
    )
    assert arc.status.ok and Counting.steps >= arc.steps > 10
    assert arc.fired.size and arc.t == pytest.approx(0.5 * np.pi, abs=1e-7)
