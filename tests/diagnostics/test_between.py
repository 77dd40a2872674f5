"""What lies between the samples of a run: states that methods keep there, and two-folds that
samples do not show."""

import dataclasses

import numpy as np
import pytest

from nsbench import Case, Filippov, solvers
from nsbench.diagnostics.run_view import RunView
from nsbench.trajectory import STATES_BETWEEN

METHODS = {
    "euler": {"h": 1e-3},
    "euler[implicit=true]": {"h": 1e-3},
    "penalty": {"k": 1e4},
    "nosnoc": {"h": 0.1},
    "event_driven": {},
}
# (which side is weak, samples, how weak): every two of these together, for each method. Steps of
# nosnoc end at samples: more of them are shorter steps, ten times as slow, and no other way.
LATE = [
    (spec, mirrored, samples, least)
    for spec in METHODS
    for samples in ((2, 11) if spec == "nosnoc" else (2, 11, 201))
    for mirrored, least in (
        ((1.0, 1e-4), (-1.0, 1e-8)) if samples == 11 else ((1.0, 1e-8), (-1.0, 1e-4))
    )
]


def folds(plus, minus, samples=2, end=1.0, x0=(0.0, 0.0)):
    """x0 slides on x0 = 0 while plus < 0 < minus, both (t, y) -> the speed across it; y grows with
    time."""
    side = lambda speed: lambda xp: lambda t, x: xp.array([speed(t, x[1]), 1.0 + 0.0 * x[0]])
    return Case(
        "folds",
        Filippov({(1,): side(plus), (-1,): side(minus)}, lambda xp: lambda t, x: x[:1]),
        x0=np.array(x0),
        t=np.linspace(0.0, end, samples),
    )


@pytest.mark.long
@pytest.mark.survives("repulsive")
@pytest.mark.parametrize("by, samples", [("time", 2), ("state", 11)])
@pytest.mark.parametrize("spec", METHODS)
def test_a_state_that_slides_into_a_two_fold_is_told(spec, by, samples):
    """Beyond it each method follows one of many solutions, and they differ."""
    of = {"time": lambda t, y: t, "state": lambda t, y: y}[by]
    case = folds(lambda t, y: 2.0 * (of(t, y) - 0.5), lambda t, y: 0.5 - of(t, y), samples)
    assert solvers.solve(case, spec, **METHODS[spec]).status.code == "degenerate"
    assert (
        solvers.solve(
            case.replace(unique=False, distance=lambda t, x: 0.0), spec, **METHODS[spec]
        ).status.ok
        or spec == "event_driven"
    )


@pytest.mark.long
@pytest.mark.parametrize("spec", METHODS)
@pytest.mark.parametrize(
    "first, second, samples", [(0.5, 0.503, 2), (0.5, 0.503, 11), (0.5, 2.0, 2)]
)
def test_a_state_that_leaves_where_one_field_turns_first_is_right(spec, first, second, samples):
    case = folds(lambda t, y: 2.0 * (t - first), lambda t, y: second - t, samples)
    run = solvers.solve(case, spec, **METHODS[spec])
    assert run.status.ok and abs(run.x[-1, 0] - (1.0 - first) ** 2) < 5e-3


@pytest.mark.parametrize("spec", ["euler", "euler[implicit=true]", "penalty"])
def test_what_is_kept_between_samples_is_the_run(spec):
    """The same states as samples there; no more than asked for, in order, and none so near that
    weights are rounding."""
    case = folds(lambda t, y: -1.0 - y, lambda t, y: 1.0, x0=(0.3, 0.0))
    run = solvers.solve(case, spec, **METHODS[spec])
    t, x, impulse = run.between
    assert (
        STATES_BETWEEN / 2 < len(t) <= STATES_BETWEEN
        and np.all(np.diff(t) > 0.0)
        and 0.0 < t[0]
        and t[-1] <= 1.0
    )
    if spec != "penalty":
        sampled = solvers.solve(case.replace(t=np.linspace(0.0, 1.0, 101)), spec, **METHODS[spec])
        same = np.searchsorted(sampled.t, t - 1e-9)
        assert (
            np.allclose(sampled.t[same], t)
            and np.allclose(sampled.x[same], x)
            and np.allclose(sampled.impulse[same], impulse)
        )
    whole = RunView(case, run)
    assert (
        np.all(np.diff(whole.t) > 0.0)
        and len(whole.t) == len(whole.x) == len(whole.impulse) > STATES_BETWEEN / 2
    )
    more = (
        np.append(t, t[-1] + 1e-9),
        np.append(x, x[-1:], axis=0),
        np.append(impulse, impulse[-1:], axis=0),
    )
    twice = dataclasses.replace(run, between=more)
    assert np.array_equal(RunView(case, twice).t, whole.t)


def test_steps_longer_than_samples_are_kept_as_they_are():
    run = solvers.solve(folds(lambda t, y: -1.0, lambda t, y: 1.0, 11), "euler", h=0.25)
    assert np.allclose(run.between[0], [0.25, 0.75])


def test_runs_with_many_samples_and_without_surfaces_keep_nothing():
    run = solvers.solve(
        folds(lambda t, y: -1.0, lambda t, y: 1.0, 2 * STATES_BETWEEN), "euler", h=1e-3
    )
    assert len(run.between[0]) == 0
    assert solvers.solve("smooth", "euler", h=0.1).between is None


@pytest.mark.long
@pytest.mark.survives("repulsive")
@pytest.mark.parametrize(
    "plus, minus, code",
    [(1.0, -1.0, "degenerate"), (1.0, 1.0, "ok"), (-1.0, 1.0, "ok"), (1.0, -1e-6, "ok")],
)
@pytest.mark.parametrize("spec", ["euler", "euler[implicit=true]", "nosnoc"])
def test_a_start_from_which_both_fields_lead_away_is_told(spec, plus, minus, code):
    """Each method takes one of its solutions. A field that is hardly one is no reason to say so."""
    run = solvers.solve(
        folds(lambda t, y: plus + 0.0 * y, lambda t, y: minus + 0.0 * y), spec, h=0.1
    )
    assert run.status.code == code


@pytest.mark.parametrize("spec", ["euler", "euler[implicit=true]"])
@pytest.mark.parametrize("away, code", [(lambda s: s, "degenerate"), (lambda s: -s, "ok")])
def test_a_start_in_a_corner_from_which_fields_lead_away_is_told(spec, away, code):
    case = Case(
        "corner",
        Filippov.signs(
            lambda xp: lambda t, x, s: away(s) + 0.0 * x, lambda xp: lambda t, x: x + 0.0
        ),
        x0=np.zeros(2),
        t=np.linspace(0.0, 1.0, 2),
    )
    assert solvers.solve(case, spec, h=0.01).status.code == code


@pytest.mark.parametrize("second, code", [(0.5, "degenerate"), (0.6, "ok")])
def test_weights_of_long_explicit_steps_are_of_some(second, code):
    case = folds(lambda t, y: 2.0 * (t - 0.5), lambda t, y: second - t, 11)
    assert solvers.solve(case, "euler", h=0.02).status.code == code


@pytest.mark.parametrize("spec", ["euler[implicit=true]", "penalty"])
def test_fields_beside_another_surface_that_is_slid_on_tell_nothing(spec):
    """On the negative side of surface 1 both fields lead away from surface 0; on surface 1 they
    lead to it at all times."""
    field = lambda xp: (
        lambda t, x, s: xp.array([-(0.6 + s[1]) * s[0], 0.5 * xp.sin(20.0 * t) - s[1], 1.0])
    )
    case = Case(
        "both",
        Filippov.signs(field, lambda xp: lambda t, x: x[:2]),
        x0=np.zeros(3),
        t=np.linspace(0.0, 1.0, 21),
    )
    assert solvers.solve(case, spec, **METHODS[spec]).status.ok


@pytest.mark.long
@pytest.mark.parametrize("samples", [2, 21])
@pytest.mark.parametrize("spec", ["euler", "euler[implicit=true]", "penalty"])
def test_a_slide_that_crosses_another_surface_beyond_which_both_fields_lead_away_is_told(
    spec, samples
):
    field = lambda xp: lambda t, x, s: xp.array([(0.1 - s[0]) * s[1], 1.0 + 0.0 * x[0]])
    case = Case(
        "over",
        Filippov.signs(field, lambda xp: lambda t, x: xp.array([x[0], 0.503 - x[1]])),
        x0=np.zeros(2),
        t=np.linspace(0.0, 1.0, samples),
    )
    assert solvers.solve(case, spec, **METHODS[spec]).status.code == "degenerate"


@pytest.mark.parametrize("spec", ["euler", "euler[implicit=true]"])
def test_rounding_of_fields_along_a_surface_leads_nowhere(spec):
    """Along a circle both fields make of its switch, which is of order 1e-16 then, what rounding
    makes of it."""
    turn = lambda way: lambda xp: lambda t, x: way * xp.array([-x[1], x[0]])
    circle = Filippov(
        {(1,): turn(1.0), (-1,): turn(2.0)},
        lambda xp: lambda t, x: xp.array([x[0] * x[0] + x[1] * x[1] - 1.0]),
    )
    for angle in np.linspace(0.1, 6.0, 12):
        case = Case(
            "circle",
            circle,
            x0=np.array([np.cos(angle), np.sin(angle)]),
            t=np.linspace(0.0, 1.0, 2),
        )
        assert "more than one" not in str(solvers.solve(case, spec, h=0.01).status)


@pytest.mark.long
@pytest.mark.parametrize("spec, mirrored, samples, least", LATE)
def test_a_slide_that_a_method_leaves_late_is_told(spec, mirrored, samples, least):
    """The field that leads back to the surface does so by `least` alone; the other turns away at
    0.5, and there the state leaves:
    explicit steps that went over the surface once are still beside it at the end, weights in a
    layer lag behind."""
    weak = lambda t, y: -mirrored * least
    turns = lambda t, y: mirrored * (0.5 - t)
    case = folds(*((weak, turns) if mirrored > 0.0 else (turns, weak)), samples)
    run = solvers.solve(case, spec, **METHODS[spec])
    assert (
        run.status.code == "unverified"
        if spec in ("euler", "penalty")
        else not run.status.ok or abs(run.x[-1, 0] + mirrored * 0.125) < 1e-3
    )


@pytest.mark.long
@pytest.mark.parametrize("plus, jumps", [(-0.5, True), (-0.02, False), (-0.02, True)])
@pytest.mark.parametrize("spec", ["euler", "penalty"])
def test_a_slide_that_a_method_leaves_in_time_is_right(spec, jumps, plus):
    """Where the field turns suddenly too."""
    minus = (
        (lambda t, y: 0.5 * (0.5 - t) / (abs(0.5 - t) + 1e-9)) if jumps else (lambda t, y: 0.5 - t)
    )
    case = folds(lambda t, y: plus, minus, 11)
    run = solvers.solve(case, spec, **METHODS[spec])
    assert run.status.ok and abs(run.x[-1, 0] + (0.25 if jumps else 0.125)) < 2e-2


@pytest.mark.parametrize("samples", [2, 11])
def test_a_state_that_comes_near_a_surface_by_itself_is_not_late(samples):
    """And was never over it: its own field alone moves it."""
    case = folds(lambda t, y: -1e-4, lambda t, y: 0.5 - t, samples, x0=(4e-4, 0.0))
    run = solvers.solve(case, "euler", h=1e-3)
    assert run.status.ok and abs(run.x[-1, 0] - 3e-4) < 1e-12
