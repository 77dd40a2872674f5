"""Kinks and jumps inside a step deceive its estimate by chance; none costs more than a few
tolerances."""

import numpy as np
import pytest
from event_scenes import scene

from nsbench.solvers import solve

PLACES = np.random.default_rng(1).uniform(0.02, 0.98, 25)


def kink(at):
    return lambda xp: (
        lambda t, x: xp.array([1.0 + 0.0 * x[0], xp.abs(x[0] - at), xp.cos(3.0 * x[0])])
    )


def jump(at):
    return lambda xp: (
        lambda t, x: xp.array([1.0 + 0.0 * x[0], xp.where(t < at, -1.0, 1.0), xp.cos(3.0 * x[0])])
    )


KINDS = {
    "kink": (kink, lambda at: 0.5 * (at**2 + (1.0 - at) ** 2)),
    "jump": (jump, lambda at: 1.0 - 2.0 * at),
}


@pytest.mark.long
@pytest.mark.parametrize(
    "kind, spec, tol",
    [
        ("kink", "event_driven", 1e-6),
        ("kink", "event_driven[method=rk45]", 1e-6),
        ("jump", "event_driven[method=rk45]", 1e-10),
    ],
)
def test_a_kink_costs_no_more_than_some_tolerances_wherever_it_is(kind, spec, tol):
    drift, end = KINDS[kind]
    runs = [
        solve(scene(drift(at), x0=np.zeros(3), t=np.linspace(0.0, 1.0, 6)), spec, tol=tol)
        for at in PLACES
    ]
    assert all(r.status.ok for r in runs)
    assert max(abs(r.x[-1, 1] - end(at)) for r, at in zip(runs, PLACES, strict=True)) <= 3.0 * tol
