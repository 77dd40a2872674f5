"""Extrapolated variants reach the order that they claim, say when their error cannot be told, and fail as their runs do."""
import numpy as np
import pytest

import nsbench
from nsbench import Affine, Case, Complementarity, errors, get_case, solve
from nsbench.solvers import get
from nsbench.solvers._extrapolation import combined, weights
from nsbench.trajectory import Status, Trajectory


def test_weights_cancel_the_first_powers():
    assert np.allclose(weights(1), [-1, 2]) and np.allclose(weights(2), np.array([1, -6, 8]) / 3)
    for times in range(5):
        e = 2.0 ** -np.arange(times + 1)
        assert [abs(weights(times) @ e**p - (p == 0)) < 1e-12 for p in range(times + 1)] == [True] * (times + 1)


@pytest.mark.parametrize("times", [1, 2])
def test_combination_of_a_known_expansion(times):
    """x(e) = 1 + sum e^q, with a contact that acts in one run only."""
    t = np.linspace(0, 1, 3)

    def run(level):
        e, c = 0.1 * 2.0**-level, ((0, 1),) if level else ((0, 0), (0, 1))
        v = np.full((3, 1), 1 + e + e**2 + 7 * e**3)
        return Trajectory(t, v, c, np.repeat(v, len(c), 1), v, stats={"steps": 5, "x_peak": level, "loop": "compiled"})
    runs = [run(level) for level in range(times + 1)]
    out = combined(runs, 0.1)
    left = 7 * 0.1**3 * weights(times) @ 8.0 ** -np.arange(times + 1)
    if times == 1:
        left += 0.1**2 * weights(1) @ 4.0 ** -np.arange(2)
    assert np.allclose(out.x, 1 + left, atol=1e-15) and np.allclose(out.reaction, out.x) and out.contacts == ((0, 0), (0, 1))
    assert np.allclose(out.impulse[:, 1], out.x[:, 0]) and np.allclose(out.impulse[:, 0], weights(times)[0] * runs[0].x[:, 0])
    assert out.stats["steps"] == 5 * (times + 1) and out.stats["x_peak"] == times and out.stats["h"] == 0.1
    bad = [*runs[:-1], Trajectory(t, runs[-1].x * np.nan, ((0, 1),), runs[-1].x, runs[-1].x, Status("nan", "It broke."))]
    assert combined(bad, 0.1).status.why == "It broke." and np.isnan(combined(bad, 0.1).impulse).all()


def slope(name, spec, ks, quantity="state_sup"):
    case = get_case(name)
    rows = [errors(case, solve(case, spec, k=k)) for k in ks]
    return nsbench.fit_order(1 / ks, np.array([r[quantity] for r in rows])).order, rows


@pytest.mark.parametrize("name", ["tide", "three_discs", "slide_exit"])
def test_penalty_once_extrapolated_has_order_two(name):
    """From where the layer behind the impact has died out at the next sample: sup over all samples, impulses too."""
    ks = np.geomspace(900.0, 7200.0, 7)
    for quantity in ("state_sup", "impulse"):
        order, rows = slope(name, "penalty[extrapolate=1]", ks, quantity)
        assert abs(order - 2.0) < 0.05 and rows[-1][quantity] < 3e-7


@pytest.mark.parametrize("name, least", [("three_discs", 2.9), ("slide_exit", 2.7)])
def test_penalty_twice_extrapolated_has_order_three(name, least):
    ks = np.geomspace(150.0, 1200.0, 7)
    order, rows = slope(name, "penalty[extrapolate=2]", ks, "state_T")
    assert order > least and rows[-1]["state_sup"] < 1e-8
    assert get("penalty[extrapolate=2]").claims.state == 3.0


def test_an_error_that_cannot_be_told_is_unverified():
    for spec, good, hidden in (("penalty[extrapolate=1]", 4e4, 8e4), ("penalty[extrapolate=2]", 2e3, 4e3)):
        assert solve("tide", spec, k=good).status.ok
        assert solve("tide", spec, k=hidden).status.code == "unverified"


def test_failures_and_refusals_pass_through():
    wild = Case("wild", Complementarity(lambda xp: lambda t, x: x * x, (Affine(np.eye(1), np.zeros(1)),)), np.ones(1),
                np.linspace(0, 2, 11))
    assert solve(wild, "penalty[extrapolate=1]", k=100.0).status.code == "diverged"
    assert solve("rlc_diode", "penalty[extrapolate=1]").status.code == "refused"
