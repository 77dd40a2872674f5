"""Bounds are proven for the constants of the drift around the run, not at a few states of it."""

import numpy as np
import pytest

import nsbench
from nsbench import Affine, Case, Complementarity, Distance
from nsbench.error_bars.drift import Drift
from nsbench.error_bars.growth import LOOKS, Tube, enclosed_drift, linear_drift

FLOOR = Affine(np.eye(1), np.zeros(1))


def swelling(xp):
    """Its derivative, 1 - cos 2 pi t, vanishes at all whole times."""
    return lambda t, x: (1.0 - xp.cos(2.0 * np.pi * t)) * x + 1.0 + t


def scene(drift, constraints=(FLOOR,), start=0.1, end=4.0, samples=41):
    t = np.linspace(0.0, end, samples)
    return Case("scene", Complementarity(drift, constraints), np.array([start]), t)


@pytest.mark.parametrize("method", ["pbd", "catching_up"])
def test_a_derivative_that_depends_on_time_is_not_only_seen_where_it_vanishes(method):
    """The bound was a quarter of the error: L was 0 at the five states that were looked at."""
    case = scene(swelling)
    exact = nsbench.solve(case, "event_driven")
    assert exact.status.ok
    for h in (1e-2, 1e-3):
        run = nsbench.solve(case, method, h=h)
        error = np.abs(run.x - exact.x)[:, 0]
        force = np.abs(run.reaction - exact.reaction)[:, 0]
        assert run.bound.is_proven and (run.bound.state >= error).all()
        assert (run.bound.reaction >= force).all()
        assert run.bound.state.max() < 1.1 * error.max()


def test_a_tolerance_that_is_proven_is_kept_there():
    case = scene(swelling)
    exact = nsbench.solve(case, "event_driven")
    run = nsbench.solve(case, "pbd", h=1e-3)
    kept = nsbench.solve(case, "pbd[tol=1e-2]")
    size = np.abs(exact.x).max()
    assert run.bound.is_proven and np.abs(kept.x - exact.x).max() <= 1e-2 * size


def threshold(xp):
    return lambda t, x: 5.0 * xp.maximum(0.0, x) + xp.maximum(0.0, t * (1.0 - t))


def ramp(xp):
    return lambda t, x: 0.2 + t + 2.0 * (1.0 + xp.tanh((x - 1.0) / 0.01))


@pytest.mark.parametrize(
    "drift, start, h", [(threshold, -1 / 6 + 0.05**2 / 12, 0.05), (ramp, 0.1, 1e-3)]
)
def test_a_drift_that_changes_beside_the_run_has_an_estimate(drift, start, h):
    """At the threshold the run stays below 0, and the exact motion leaves it: no look along the
    run tells."""
    case = scene(drift, (Affine(-np.eye(1), np.full(1, 3.0)),), start, 2.0)
    run = nsbench.solve(case, "pbd", h=h)
    assert np.isfinite(run.bound.state).all() and not run.bound.is_proven


def test_a_smooth_drift_is_enclosed_in_a_tube_as_wide_as_the_error():
    case = scene(lambda xp: lambda t, x: xp.sin(x) - 2.0 * x + t, start=0.5)
    exact = nsbench.solve(case, "event_driven")
    run = nsbench.solve(case, "pbd", h=1e-2)
    error = np.abs(run.x - exact.x)[:, 0]
    assert run.bound.is_proven and (run.bound.state >= error).all()
    assert run.bound.state.max() < 3.0 * error.max()


def test_constants_hold_in_every_box_of_the_tube():
    t = np.linspace(0.0, 4.0, 41)
    X = np.zeros((41, 2))
    drift = Drift(lambda xp: lambda t, x: xp.array([t * x[1], -x[0] * x[0]]), 2)
    guess = linear_drift(drift, t, X)
    assert len(t) > LOOKS and not guess.is_proven
    ends = np.linspace(0.0, 4.0, 5)
    tube = Tube(ends, np.zeros((4, 2)), np.zeros((4, 2)), np.arange(40) // 10).widened(0.5)
    found = enclosed_drift(guess, drift, tube)
    assert found.is_proven and len(found.boxes) == 4
    inside = np.array([[0.5, -0.5], [0.0, 0.0]])
    assert found.at(0).holds_at(inside) and not found.at(0).holds_at(inside + 1e-6)
    rng = np.random.default_rng(5)
    for s, (a, b) in zip(rng.uniform(0, 4, 200), rng.uniform(-0.5, 0.5, (200, 2)), strict=True):
        J = np.array([[0.0, s], [-2.0 * a, 0.0]])
        L = np.linalg.eigvalsh(0.5 * (J + J.T))[-1]
        for part in (found, found.at(min(int(s / 0.1), 39))):
            assert np.linalg.norm(J - part.J, 2) <= part.change
            assert np.linalg.norm(J, 2) <= part.two_sided and L <= part.one_sided


def wall(xp):
    return lambda t: (10.0 + xp.sin(t)) * xp.ones(1)


def test_a_particle_that_jumped_over_an_anchor_is_seen_beside_a_moving_wall():
    drift = lambda xp: lambda t, x: -1.0 * xp.ones_like(x)
    post = Distance(d=0.1, anchors=np.zeros((1, 1)), dim=1)
    case = scene(drift, (post, Affine(-np.eye(1), wall)), 0.45, 3.0, 11)
    run = nsbench.solve(case, "pbd", h=0.3)
    assert run.x[-1, 0] < 0.0 and not run.bound.is_proven and "passed" in run.bound.why
    assert nsbench.solve(case, "catching_up", h=0.3).bound.is_proven


@pytest.mark.long
def test_a_wall_that_moves_between_the_quarters_of_a_step_is_seen():
    """At the quarters its velocity vanishes; the bar says that the run knows nothing of it."""
    h = 0.1
    floor = Affine(
        np.array([[1.0, 0.0]]),
        lambda xp: lambda t: -0.02 * xp.sin(4.0 * np.pi * t / h) ** 2 * xp.ones(1),
    )
    drift = lambda xp: lambda t, x: xp.array([-1.0 + 0.0 * x[0], x[0]])
    t = np.linspace(0.0, 2.0, 21)
    case = Case("wall", Complementarity(drift, (floor,)), np.zeros(2), t)
    run = nsbench.solve(case, "pbd", h=h)
    exact = nsbench.solve(case, "event_driven")
    assert (run.bound.state >= np.linalg.norm(run.x - exact.x, axis=1)).all()
    assert run.bound.state.max() > 2.0
