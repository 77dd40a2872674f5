"""A multiplier is compared at its own time in the step; the columns beside it show what another
time would have cost."""

import numpy as np
import pytest

import nsbench
from nsbench import Case, get_case, solve
from nsbench.measure.multiplier_times import OWN, PLACES, exact_multiplier
from nsbench.solvers import grid
from nsbench.solvers.base import last_steps
from nsbench.trajectory import Trajectory

HALF = "theta[theta=0.5]"


@pytest.mark.long
@pytest.mark.parametrize("key", ["tide", "rlc_diode"])
def test_the_trapezoid_has_order_two_at_its_own_label_and_one_at_the_others(key):
    rows = nsbench.run(key, HALF).rows
    assert all(r["status"] == "ok" for r in rows) and len(rows) >= 19
    h = [r["h"] for r in rows]
    for name, order in (
        ("lam_own", 2.0),
        ("lam_at_mid", 2.0),
        ("lam_mean", 2.0),
        ("lam_at_end", 1.0),
        ("lam_at_start", 1.0),
    ):
        fit = nsbench.fit_order(h, [r[name] for r in rows], floor=max(r["lam_floor"] for r in rows))
        assert fit.order == pytest.approx(order, abs=0.1), (name, fit)
    last = rows[-1]
    assert last["lam_own"] == last["lam_at_mid"] < 1e-2 * last["lam_at_end"]


def test_what_half_a_step_costs_is_the_slope_of_the_multiplier():
    """lam = cos t between its events: the wrong end costs h/2 sin t at the latest of the samples
    that count."""
    h = 0.005
    case = get_case("tide")
    e = nsbench.errors(case, solve(case, HALF, h=h))
    held = case.t[(case.t > np.pi / 6 + 0.1) & (case.t < np.pi / 2 - 0.1)]
    assert e["lam_at_end"] == pytest.approx(h / 2 * np.sin(held.max()), rel=0.05)
    assert e["lam_at_mid"] == pytest.approx(h**2 / 8 * np.cos(held.min()), rel=0.05)
    assert e["lam_mean"] == pytest.approx(h**2 / 12 * np.cos(held.min()), rel=0.05)


@pytest.mark.parametrize(
    "spec, right, wrong",
    [
        ("theta", "lam_at_end", "lam_at_start"),
        ("pbd", "lam_at_start", "lam_at_end"),
        ("catching_up", "lam_at_start", "lam_at_end"),
    ],
)
def test_first_order_methods_on_tide(spec, right, wrong):
    """Implicit Euler takes the force at the end of the step, projections after explicit Euler take
    it at the start:
    there lam is exact, and at the other end a whole step is between."""
    e = nsbench.errors(get_case("tide"), solve("tide", spec, h=0.005))
    assert e[right] < 1e-11 and e["lam_at_mid"] > 1e-3 and e[wrong] > 2e-3
    assert e["lam_own"] == e[right]


def test_methods_without_steps_have_interval_means():
    case = get_case("tide")
    e = nsbench.errors(case, solve(case, "event_driven"))
    assert (
        e["lam_own"] == e["lam_mean"] < 1e-13 and e["lam_at_end"] > 1e-2 and e["lam_at_mid"] > 1e-5
    )


def exact_steps(label, case, h=0.01):
    """A run whose multipliers are those of tide at the given part of each step."""
    part = {"start": 1.0, "midpoint": 0.5, "end": 0.0}[label]
    lam = np.where((case.t > np.pi / 6) & (case.t < np.pi / 2), np.cos(case.t - part * h), 0.0)[
        :, None
    ]
    P = case.exact_impulse(case.t)
    return Trajectory(
        case.t,
        case.exact(case.t),
        ((0, 0),),
        P,
        P,
        lam_time=label,
        lam=lam,
        lam_h=np.full(len(case.t), h),
    )


@pytest.mark.parametrize("label", ["start", "midpoint", "end"])
def test_each_label_is_told_from_the_others(label):
    case = get_case("tide")
    e = nsbench.errors(case, exact_steps(label, case))
    assert e["lam_own"] == e[OWN[label]] < 1e-12
    assert min(e[n] for n in PLACES if n != OWN[label]) > 4e-3


def test_nodal_multipliers_are_exact_to_what_they_say():
    case = get_case("rlc_diode")
    t = np.array([3e-5, 7e-4, 1.9e-3])
    lam, error = exact_multiplier(case, t, 2.5e-5)
    want = np.maximum(case.exact(t)[:, :1], 0.0) / 1e3
    assert np.abs(lam - want).max() < 1e-13 and error.max() < 1e-13


def test_nothing_is_said_where_nothing_is_known():
    tide = get_case("tide")
    coarse = nsbench.errors(
        tide, solve(tide, "theta", h=0.2)
    )  # steps longer than the sample spacing
    plain = tide.replace(exact_impulse=None)
    for e in (
        coarse,
        nsbench.errors(plain, solve(plain, "theta", h=0.01)),
        nsbench.errors(get_case("slide_exit"), solve("slide_exit", "euler")),
    ):
        assert all(np.isnan(e[k]) for k in (*PLACES, "lam_own", "lam_mean", "lam_floor"))


@pytest.mark.parametrize("n", [1, 2, 7])
def test_recording_the_last_steps_changes_no_step(n):
    t = np.array([0.0, 0.1, 0.3, 0.35, 0.6])
    a = grid(t, 0.05 / n)
    b = grid(t, 0.05 / n, last=True)
    nodes = lambda g: np.concatenate(
        [np.linspace(p, q, k + 1)[1:] for p, q, k in zip(g.t, g.t[1:], g.substeps, strict=False)]
    )
    assert a.substeps.sum() == b.substeps.sum() and a.h == b.h
    np.testing.assert_allclose(nodes(a), nodes(b), rtol=1e-14)
    lam = last_steps(t, b, np.sin(b.t)[:, None])
    np.testing.assert_allclose(lam["lam_h"][1:], np.diff(t) / a.substeps, rtol=1e-12)
    h = lam["lam_h"][1:]
    np.testing.assert_allclose(
        lam["lam"][1:, 0], (np.sin(t[1:]) - np.sin(t[1:] - h)) / h, rtol=1e-10
    )
    assert (
        last_steps(t, a, np.sin(a.t)[:, None]) == {}
        and last_steps(t, grid(t, 0.2, last=True), np.zeros((5, 1))) == {}
    )


def test_runs_are_the_same_with_and_without_a_known_multiplier():
    tide = get_case("tide")
    for spec in ("pbd", "catching_up", "theta", HALF):
        a, b = (solve(c, spec, h=0.05 / 7) for c in (tide, tide.replace(exact_impulse=None)))
        assert a.lam.shape == (61, 1) and b.lam is None and a.stats == b.stats
        assert np.abs(a.x - b.x).max() < 1e-14 and np.abs(a.impulse - b.impulse).max() < 1e-14


def test_weights_of_a_relay_have_labels_too():
    sliding = get_case("sliding")
    e = nsbench.errors(sliding, solve(sliding, "euler[implicit=true]", h=0.01))
    assert e["lam_own"] == e["lam_at_end"] < 1e-11
    assert (
        isinstance(sliding, Case)
        and nsbench.errors(sliding, solve(sliding, "euler", h=0.01))["lam_own"] > 0.4
    )
