"""Surfaces that are one, or whose normals are dependent: which sectors there are, and penalties
whose layers mix others."""

import numpy as np
import pytest

from nsbench import Case, Filippov, solve
from nsbench.diagnostics.filippov.dependent_surfaces import sector_signs


@pytest.mark.parametrize(
    "normals, sectors",
    [
        ([[1.0, 0.0], [0.0, 3.0]], 4),
        ([[2.0, 1.0], [1e-6, 5e-7]], 2),  # one surface, twice
        ([[2.0, 1.0], [-4.0, -2.0]], 2),
        ([[1.0, 0.0], [0.0, 1e-12]], 4),
        ([[1.0, 0.0], [0.0, 1.0], [1.0, 1.0]], 6),  # three lines through a point
        ([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], 8),
    ],
)
def test_sectors_around_a_point(normals, sectors):
    found = sector_signs(np.array(normals))
    drawn = np.unique(
        np.sign(
            np.random.default_rng(0).normal(size=(2000, len(normals[0]))) @ np.array(normals).T
        ),
        axis=0,
    )
    assert len(found) == sectors and np.array_equal(np.unique(found, axis=0), drawn)


def twice(steep, unit=1.0, both=0.5):
    """x slides on 0, where two switches vanish, of slopes 1 and `steep`; y goes with the sign of
    either."""

    def drift(xp):
        return lambda t, x: unit * xp.array([0.4 + 0.0 * t, 1.0])

    def switch(xp):
        return lambda t, x: xp.array([xp.sin(x[0] / unit), steep * x[0] / unit])

    return Case(
        "twice",
        Filippov.relay(drift, -unit * np.array([[1.0, 0.0], [0.0, both]]), switch),
        unit * np.zeros(2),
        np.linspace(0.0, 1.0, 21),
    )


@pytest.mark.long
@pytest.mark.parametrize("unit", (1.0, 1e-8))
def test_layers_of_different_thickness_around_one_surface_are_told(unit):
    """Both signs have the mean 0.4 at the sides of x = 0: y' = 0.8. In layers the second has 0.4 x
    steep, or 1."""
    right = solve(twice(3.0, unit), "euler", h=1e-4)
    assert right.status.ok and right.x[-1, 1] == pytest.approx(0.8 * unit, rel=1e-3)
    run = solve(twice(3.0, unit), "penalty", k=1e4)
    assert run.x[-1, 1] == pytest.approx(0.5 * unit, rel=1e-3)
    assert run.status.code == "unverified" and "surfaces 0, 1, whose normals are dependent" in str(
        run.status
    )


@pytest.mark.long
@pytest.mark.parametrize("steep, both", ((1.0, 0.5), (3.0, 0.0)))
def test_layers_that_mix_as_the_surface_does_are_not(steep, both):
    """Of one thickness; or of a switch on which nothing depends."""
    run = solve(twice(steep, both=both), "penalty", k=1e4)
    assert run.status.ok and run.x[-1, 1] == pytest.approx(1.0 - 0.4 * both, rel=1e-3)


@pytest.mark.long
def test_more_surfaces_than_are_examined_in_a_corner_are_no_fault():
    """Lasso flow x' = -(M x - b) - 0.3 s, s in Sgn(x), in six coordinates: five come to rest at
    zero, where the field of a side depends on one sign alone."""
    rng = np.random.default_rng(0)
    A = rng.normal(size=(8, 6))
    M = A.T @ A / 6
    b = A.T @ rng.normal(size=8) / 6
    problem = Filippov.signs(
        lambda xp: lambda t, x, s: -(M @ x - b) - 0.3 * s, lambda xp: lambda t, x: x + 0.0
    )
    run = solve(
        Case("lasso", problem, rng.normal(size=6), np.linspace(0.0, 5.0, 6)), "event_driven"
    )
    assert run.status.ok
