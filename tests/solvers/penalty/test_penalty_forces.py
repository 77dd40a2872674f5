"""The penalty method's forces are minus the gradient of its energy, and it reports where rounding
of the coordinates decides them."""

import numpy as np
import pytest

import nsbench
from nsbench import Affine, Case, Complementarity, Distance, Filippov, Smooth, solve
from nsbench.dynamics.contacts.constraint_set import ConstraintSet
from nsbench.solvers.penalty.forces import constraint_ids, count, right_hand_side


def plane(dim):
    """All families at once: discs with radii, one disc size, links, fixed and moving anchors,
    moving wall, curved ones."""
    n = 5 * dim + 1
    curved = lambda xp: (
        lambda t, x: xp.stack([0.3 - x[0] ** 2 - xp.sin(t) * x[1], x[0] * x[n - 1] - 1.0])
    )
    slope = lambda xp: (
        lambda t, x: xp.stack(
            [
                xp.concatenate([xp.stack([-2.0 * x[0], -xp.sin(t)]), xp.zeros(n - 2)]),
                xp.concatenate([xp.stack([x[n - 1]]), xp.zeros(n - 2), xp.stack([x[0]])]),
            ]
        )
    )
    rows = np.random.default_rng(5).normal(size=(3, n))
    return Complementarity(
        lambda xp: lambda t, x: -x,
        (
            Distance(radii=np.linspace(0.5, 0.9, 5), dim=dim, count=5),
            Distance(1.4, dim=dim, start=1, count=5),
            Distance(np.array([0.2, 0.3]), sign=-1, pairs=[[0, 1], [4, 2]], dim=dim, count=5),
            Distance(1.5, anchors=np.ones((2, dim)), dim=dim, count=5),
            Distance(
                0.4,
                sign=-1,
                pairs=[[3, 0]],
                dim=dim,
                count=5,
                anchors=lambda xp: lambda t: xp.stack([xp.cos(t) * xp.ones(dim)]),
            ),
            Affine(rows, lambda xp: lambda t: xp.sin(t) * xp.ones(3)),
            Affine(-rows[:1], np.zeros(1)),
            Smooth(curved),
            Smooth(curved, slope),
        ),
    ), n


@pytest.mark.long
@pytest.mark.parametrize("dim", [1, 2, 3])
def test_forces_are_minus_the_gradient_of_the_energy(dim):
    """Against central differences of k/2 sum max(-g, 0)^2, with the gaps of
    nsbench.dynamics.contacts.constraint_set."""
    import jax

    problem, n = plane(dim)
    scene = ConstraintSet(problem, n)
    rhs = jax.jit(right_hand_side(problem, n))
    k = 7.0
    t = 0.6
    near = scene.near(np.zeros(n), 1e3)
    m = len(near)
    assert constraint_ids(problem, n) == near.ids and count(problem, n) == m
    depth = lambda x: np.maximum(-scene.gaps(t, x, near), 0.0)
    for seed in range(3):
        x = np.random.default_rng(seed).normal(size=n) * 0.8
        out = np.asarray(rhs(t, np.concatenate([x, np.zeros(m + n)]), k))
        assert (
            np.allclose(out[n : n + m], k * depth(x), atol=1e-12) and (out[n : n + m] > 0).sum() > 4
        )
        e = 1e-6
        force = [
            -(0.5 * k * (depth(x + e * u) ** 2).sum() - 0.5 * k * (depth(x - e * u) ** 2).sum())
            / (2 * e)
            for u in np.eye(n)
        ]
        assert np.allclose(out[n + m :], force, atol=1e-6) and np.allclose(
            out[:n], -x + out[n + m :], atol=1e-12
        )


@pytest.mark.survives("coincident centres")
def test_coincident_centres_are_parted_along_the_first_axis():
    problem = Complementarity(lambda xp: lambda t, x: -x, (Distance(2.0),))
    case = Case("same", problem, np.zeros(4), np.linspace(0, 1, 5), start="keep")
    traj = solve(case, "penalty", k=1e3)
    assert traj.status.code == "degenerate" and np.allclose(
        traj.x[-1], [1.0, 0.0, -1.0, 0.0], atol=2e-3
    )


def test_moving_wall_pushes_a_point_along():
    """x' = k max(v t - x, 0): x = v t - v/k (1 - e^(-k t)), and the impulse is the way gone."""
    v = 0.7
    k = 300.0
    wall = Affine(np.eye(1), lambda xp: lambda t: -v * t * xp.ones(1))
    case = Case(
        "plough",
        Complementarity(lambda xp: lambda t, x: 0.0 * x, (wall,)),
        np.zeros(1),
        np.linspace(0, 2, 9),
    )
    traj = solve(case, "penalty", k=k)
    assert np.allclose(traj.x[:, 0], v * traj.t - v / k * -np.expm1(-k * traj.t), atol=1e-8)
    assert (
        np.abs(traj.impulse - traj.x).max() < 1e-13 and np.abs(traj.reaction - traj.x).max() < 1e-13
    )


def test_reaction_and_impulse_belong_together():
    """Linear invariants survive the integration: x - x0 - integral f = reaction = impulse @ A."""
    A = np.array([[1.0, 0.2], [0.0, 1.0], [1.0, 1.0]])
    problem = Complementarity(
        lambda xp: lambda t, x: xp.zeros(2) - xp.ones(2), (Affine(A, np.array([0.0, 0.3, 5.0])),)
    )
    case = Case("corner", problem, np.array([0.4, 0.5]), np.linspace(0, 2, 9))
    traj = solve(case, "penalty", k=1e3)
    assert traj.contacts == ((0, 0), (0, 1)) and traj.stats["contacts_peak"] == 2
    assert np.abs(traj.impulse @ A[:2] - traj.reaction).max() < 1e-12
    assert np.abs(traj.x - case.x0 + traj.t[:, None] - traj.reaction).max() < 1e-12


@pytest.mark.long
@pytest.mark.parametrize("spec", ["penalty", "penalty[method=kvaerno5]"])
def test_a_motion_in_a_small_unit_has_the_digits_of_one_in_a_large(spec):
    def case(unit):
        field = lambda xp: lambda t, x, s: unit * xp.array([1.3 * xp.tanh(x[0] / unit) - s[0]])
        return Case(
            "unit",
            Filippov.signs(field, lambda xp: lambda t, x: xp.array([t - 0.7])),
            unit * np.array([0.1]),
            np.linspace(0.0, 1.0, 6),
        )

    large, small = (solve(case(unit), spec, k=1e3) for unit in (1.0, 1e-8))
    assert large.status.ok and small.status.ok and np.abs(small.x / 1e-8 - large.x).max() < 1e-6


def test_forces_of_rounding_are_told():
    """1e8 from the origin a coordinate is known to 1.5e-8: springs of 1e8 make a force of 1.5 of
    that."""

    def still(xp):
        return lambda t, x: 0.0 * x - 1.0

    case = Case(
        "far",
        Complementarity(still, (Affine(np.array([[1.0]]), np.array([-1e8])),)),
        np.array([1e8 + 0.1]),
        np.linspace(0.0, 1.0, 3),
    )
    found = nsbench.solve(case, "penalty", k=1e8)
    assert found.status.code == "maxiter" and "Rounding of the coordinates" in str(found.status)
    assert nsbench.solve(case, "penalty", k=1e2).status.code != "maxiter"


def _walled(speed, x0, column):
    row = np.zeros((1, len(x0)))
    row[0, column] = 1.0

    def drift(xp):
        return lambda t, x: xp.array(speed) + 0.0 * x

    return Case(
        "walled",
        Complementarity(drift, (Affine(row, np.array([-float(np.floor(x0[column]))])),)),
        np.array(x0),
        np.linspace(0.0, 1.0, 3),
    )


def test_coordinates_far_away_that_nothing_holds_are_no_doubt():
    """Nor forces of rounding that are small beside those of the drift."""
    assert nsbench.solve(_walled([0.0, -1.0], [5000.0, 0.5], 1), "penalty", k=1e4).status.ok
    assert (
        nsbench.solve(_walled([0.0, -1.0], [1e12, 0.5], 1), "penalty", k=1e4).status.code
        != "maxiter"
    )
    assert nsbench.solve(_walled([-1e6], [1e12], 0), "penalty", k=1e4).status.code != "maxiter"


def test_a_switch_that_comes_back_after_the_run_has_changed():
    def field(xp):
        return lambda t, x, s: xp.array([-0.3 + 0.05 * s[0]])

    def switch(xp):
        return lambda t, x: xp.sin(2.0 * np.pi * x)

    case = Case(
        "periodic", Filippov.signs(field, switch), np.array([1.0]), np.linspace(0.0, 1.0, 5)
    )
    assert nsbench.solve(case, "penalty", k=1e4).status.ok


@pytest.mark.long
@pytest.mark.parametrize("offset, samples", [(0.0, 3), (1e8, 2), (1e8, 3), (1e8, 11)])
@pytest.mark.parametrize("spec", ["penalty", "penalty[method=kvaerno5]"])
def test_a_motion_far_away_that_grows_has_grown_from_the_errors_of_its_beginning(
    spec, offset, samples
):
    """At its end it is 10^6 and the origin no more than 30 of it away; at its beginning it is 1,
    and tolerances are 0.1."""

    def field(xp):
        return lambda t, x, s: xp.array([x[0] - offset, -s[0]])

    case = Case(
        "far",
        Filippov.signs(field, lambda xp: lambda t, x: x[1:] - offset),
        np.array([offset + 1.0, offset + 1.0]),
        np.linspace(0.0, 15.0, samples),
    )
    run = nsbench.solve(case, spec, k=1e3)
    assert run.status.code == ("unverified" if offset else "ok")
    assert offset or abs(run.x[-1, 0] / np.exp(15.0) - 1.0) < 1e-3
