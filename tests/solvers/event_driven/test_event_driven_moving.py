"""Walls, anchors and smooth constraints that move push with their speed."""

import numpy as np
from event_scenes import push, scene

from nsbench import Affine, Distance, Smooth
from nsbench.solvers import solve


def test_a_moving_floor_pushes_with_its_speed():
    """g = x - a sin t, f = -b, a < b: never leaves; lam = b + a cos t."""
    a = 0.5
    b = 1.0
    case = scene(
        push(-b),
        Affine(np.eye(1), lambda xp: lambda t: -a * xp.sin(t) * xp.ones(1)),
        x0=[0.0],
        t=np.linspace(0, 10, 41),
    )
    traj = solve(case)
    assert traj.status.ok and traj.events == ()
    assert np.abs(traj.x[:, 0] - a * np.sin(case.t)).max() < 1e-11
    assert np.abs(traj.impulse[:, 0] - b * case.t - a * np.sin(case.t)).max() < 1e-10


def test_a_fast_floor_throws_and_catches():
    """a > b: released where a cos t = -b, flies with slope -b, caught where a sin t meets the
    line."""
    from scipy.optimize import brentq

    a = 2.0
    b = 1.0
    case = scene(
        push(-b),
        Affine(np.eye(1), lambda xp: lambda t: -a * xp.sin(t) * xp.ones(1)),
        x0=[0.0],
        t=np.linspace(0, 6, 25),
    )
    up = np.arccos(-b / a)
    down = brentq(lambda t: a * np.sin(up) - b * (t - up) - a * np.sin(t), up + 0.5, 6, xtol=1e-15)
    traj = solve(case)
    assert [e.kind for e in traj.events] == ["release", "contact"]
    np.testing.assert_allclose([e.t for e in traj.events], [up, down], atol=1e-11)


def test_a_dragged_point_draws_a_tractrix():
    leash = Distance(
        d=1.0, sign=-1, anchors=lambda xp: lambda t: xp.stack((t, 0 * t)).reshape((1, 2))
    )
    case = scene(push(0.0, 0.0), leash, x0=[0.0, 1.0], t=np.linspace(0, 4, 21))
    traj = solve(case)
    exact = np.stack((case.t - np.tanh(case.t), 1 / np.cosh(case.t)), axis=1)
    assert traj.status.ok and np.abs(traj.x - exact).max() < 1e-11


def test_a_smooth_constraint_is_the_distance_it_states():
    around = push(1.0, 0.0)
    t = np.linspace(0, 4, 17)
    disc = solve(scene(around, Distance(d=1.0, anchors=np.zeros((1, 2))), x0=[-2.0, 0.2], t=t))
    same = solve(
        scene(
            around,
            Smooth(lambda xp: lambda t, x: (xp.sqrt(x[0] ** 2 + x[1] ** 2) - 1) * xp.ones(1)),
            x0=[-2.0, 0.2],
            t=t,
        )
    )
    assert (
        np.abs(disc.x - same.x).max() <= 1e-11
        and np.abs(disc.reaction - same.reaction).max() <= 1e-10
    )
    assert [e.kind for e in disc.events] == ["contact", "release"]
