"""Extrapolated variants reach the order that they claim, say when their error cannot be told, and
fail as their runs do."""

import numpy as np
import pytest

import nsbench
from nsbench import Affine, Case, Complementarity, errors, get_case, solve
from nsbench.reference import reference
from nsbench.solvers import get
from nsbench.solvers.common.extrapolation import combined, weights
from nsbench.trajectory import Status, Trajectory

FIELDS = ("t", "x", "contacts", "impulse", "reaction")


def test_weights_cancel_the_first_powers():
    assert np.allclose(weights(1), [-1, 2]) and np.allclose(weights(2), np.array([1, -6, 8]) / 3)
    for times in range(5):
        e = 2.0 ** -np.arange(times + 1)
        assert [abs(weights(times) @ e**p - (p == 0)) < 1e-12 for p in range(times + 1)] == [
            True
        ] * (times + 1)


@pytest.mark.parametrize("times", [1, 2])
def test_combination_of_a_known_expansion(times):
    """x(e) = 1 + sum e^q, with a contact that acts in one run only."""
    t = np.linspace(0, 1, 3)

    def run(level):
        e = 0.1 * 2.0**-level
        c = ((0, 1),) if level else ((0, 0), (0, 1))
        v = np.full((3, 1), 1 + e + e**2 + 7 * e**3)
        return Trajectory(
            t,
            v,
            c,
            np.repeat(v, len(c), 1),
            v,
            stats={"steps": 5, "x_peak": level, "loop": "compiled"},
        )

    runs = [run(level) for level in range(times + 1)]
    out = combined(runs, 0.1)
    left = 7 * 0.1**3 * weights(times) @ 8.0 ** -np.arange(times + 1)
    if times == 1:
        left += 0.1**2 * weights(1) @ 4.0 ** -np.arange(2)
    assert (
        np.allclose(out.x, 1 + left, atol=1e-15)
        and np.allclose(out.reaction, out.x)
        and out.contacts == ((0, 0), (0, 1))
    )
    assert np.allclose(out.impulse[:, 1], out.x[:, 0]) and np.allclose(
        out.impulse[:, 0], weights(times)[0] * runs[0].x[:, 0]
    )
    assert (
        out.stats["steps"] == 5 * (times + 1)
        and out.stats["x_peak"] == times
        and out.stats["h"] == 0.1
    )
    bad = [
        *runs[:-1],
        Trajectory(
            t, runs[-1].x * np.nan, ((0, 1),), runs[-1].x, runs[-1].x, Status("nan", "It broke.")
        ),
    ]
    assert (
        combined(bad, 0.1).status.why == "It broke." and np.isnan(combined(bad, 0.1).impulse).all()
    )


def slope(name, spec, ks, quantity="state_sup"):
    case = get_case(name)
    rows = [errors(case, solve(case, spec, k=k)) for k in ks]
    return nsbench.fit_order(1 / ks, np.array([r[quantity] for r in rows])).order, rows


@pytest.mark.long
@pytest.mark.parametrize("name", ["tide", "three_discs", "slide_exit"])
def test_penalty_once_extrapolated_has_order_two(name):
    """From where the layer behind the impact has died out at the next sample: sup over all samples,
    impulses too."""
    ks = np.geomspace(900.0, 7200.0, 7)
    for quantity in ("state_sup", "impulse"):
        order, rows = slope(name, "penalty[extrapolate=1]", ks, quantity)
        assert abs(order - 2.0) < 0.05 and rows[-1][quantity] < 3e-7


@pytest.mark.parametrize("name, least", [("three_discs", 2.8), ("slide_exit", 2.7)])
def test_penalty_twice_extrapolated_has_order_three(name, least):
    ks = np.geomspace(150.0, 1200.0, 7)
    order, rows = slope(name, "penalty[extrapolate=2]", ks, "state_T")
    assert order > least and rows[-1]["state_sup"] < 1e-8
    assert get("penalty[extrapolate=2]").claims.state == 3.0


def test_an_error_that_cannot_be_told_is_unverified():
    for spec, good, hidden in (
        ("penalty[extrapolate=1]", 1e5, 3e5),
        ("penalty[extrapolate=2]", 2e3, 4e3),
    ):
        assert solve("tide", spec, k=good).status.ok
        assert solve("tide", spec, k=hidden).status.code == "unverified"


def test_failures_and_refusals_pass_through():
    wild = Case(
        "wild",
        Complementarity(lambda xp: lambda t, x: x * x, (Affine(np.eye(1), np.zeros(1)),)),
        np.ones(1),
        np.linspace(0, 2, 11),
    )
    assert solve(wild, "penalty[extrapolate=1]", k=100.0).status.code == "diverged"
    assert solve("rlc_diode", "penalty[extrapolate=1]").status.code == "refused"


STEPS = 0.05 / np.array([8, 11, 15, 21, 29, 40, 55])


@pytest.mark.long
@pytest.mark.parametrize(
    "spec, name",
    [
        ("richardson", "three_discs"),
        ("richardson", "two_discs"),
        ("richardson", "dragged_disc"),
        ("richardson[method=catching_up]", "obstacle"),
        ("richardson[method=catching_up]", "dragged_disc"),
    ],
)
def test_steps_extrapolated_once_have_order_two(spec, name):
    """Through impacts and releases: what depends on where in its step an event lies is of size
    h^2."""
    case = get_case(name)
    method = get(spec)
    h = STEPS * np.diff(case.t).min() / 0.05
    rows = [errors(case, solve(case, spec, h=v)) for v in h]
    plain = errors(case, solve(case, method.method, h=h[-1]))
    fit = nsbench.fit_order(h, np.array([r["state_sup"] for r in rows]))
    assert abs(fit.order - 2.0) < 0.15 and rows[-1]["state_sup"] < 0.02 * plain["state_sup"]
    fit = nsbench.fit_order(h, np.array([r["reaction"] for r in rows]))
    assert abs(fit.order - 2.0) < 0.3


def test_three_levels_have_order_three_without_events_between():
    case = get_case("dragged_disc")
    h = np.diff(case.t).min() / np.array([2, 3, 4, 6, 8])
    err = [errors(case, solve(case, "richardson[levels=3]", h=v))["state_sup"] for v in h]
    assert abs(nsbench.fit_order(h, np.array(err)).order - 3.0) < 0.1


def test_what_is_halved_is_the_step_that_was_taken():
    case = get_case("tide")
    runs = [solve(case, "pbd", h=0.05 / n) for n in (3, 6)]
    out = solve(case, "richardson", h=0.02)  # three steps per sample, not two and a half
    assert out.stats["steps"] == 9 * (len(case.t) - 1) and out.stats["h"] == runs[0].stats["h"]
    assert np.array_equal(out.x, 2 * runs[1].x - runs[0].x) and np.array_equal(
        out.impulse, 2 * runs[1].impulse - runs[0].impulse
    )
    assert out.status.ok and out.contacts == runs[0].contacts and out.lam is None


def test_steps_that_cannot_be_halved_are_refused():
    tide = get_case("tide")
    assert "end at the samples" in solve(tide, "richardson", h=0.07).status.why
    uneven = tide.replace(t=np.array([0.0, 0.1, 0.23, 3.0]))
    assert "equally spaced" in solve(uneven, "richardson", h=0.05).status.why
    even = tide.replace(t=np.array([0.0, 0.1, 0.3, 3.0]))
    assert solve(even, "richardson", h=0.05).status.ok
    assert solve("sliding", "richardson").status.code == "refused"
    for option, text in (("method=euler", "method"), ("levels=4", "levels")):
        with pytest.raises(ValueError, match=text):
            get(f"richardson[{option}]")


@pytest.mark.long
@pytest.mark.parametrize(
    "spec, name, accuracies",
    [
        ("richardson", "tide", (0.05, 0.0125, 0.003125)),
        ("richardson", "wedge", (0.05, 0.0125, 0.003125)),
        ("richardson[levels=3]", "discs[n=3]", (0.05, 0.0125, 0.003125)),
        ("richardson[method=catching_up]", "obstacle", (0.05, 0.0125)),
        ("penalty[extrapolate=1]", "tide", (300.0, 5000.0)),
    ],
)
def test_error_bars_are_one_to_ten_times_the_error(spec, name, accuracies):
    """The difference to one level less was 1e5 times too large: it knew nothing of the order."""
    case = get_case(name)
    for value in accuracies:
        found = errors(case, solve(case, spec, **{get(spec).accuracy: value}))
        for bar, error in (("estimate_state", "state_sup"), ("estimate_reaction", "reaction")):
            assert 1.0 <= found[bar] / found[error] < 10.0, (value, bar)


def test_a_run_whose_finer_one_fails_has_no_error_bars():
    t = np.linspace(0, 1, 3)
    good = Trajectory(t, np.ones((3, 1)), ((0, 0),), *(np.zeros((3, 1)) for _ in range(2)))
    broken = Trajectory(*(getattr(good, n) for n in FIELDS), Status("diverged", "It left."))
    bars = combined([good, good], 0.1, get_case("tide"), lambda: broken).bound
    assert np.isnan(bars.state).all() and "half the last step" in bars.why


@pytest.mark.parametrize(
    "name, accuracies", [("graze", (0.0135, 0.0034)), ("moving_floor", (0.0125,))]
)
def test_where_all_runs_miss_a_touch_alike_the_error_bars_of_the_finest_are_taken(name, accuracies):
    """PBD lands by sqrt(h) early: at the samples about the touch all runs stand on the floor, and
    extrapolations differed by 1e-13 beside an error of 7e-4."""
    case = get_case(name)
    for h in accuracies:
        run = solve(case, "richardson", h=h)
        off = np.linalg.norm(run.x - reference(case).x, axis=1)
        assert (run.bound.state >= 0.99 * off - 1e-12).all()
        assert run.bound.state.max() < 3.0 * off.max()
