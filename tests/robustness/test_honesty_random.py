"""Random scenes of every family: what says ok is true and nothing crashes; a scene that fails is
shrunk to a case file.

The long run is tests/studies/honesty.py; what is found is kept in tests/regressions.
"""

import dataclasses
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from randomised import judge, ladder, own
from randomised.choices import Choices, drawn, replayed, shrunk
from randomised.scenes import FAMILIES, scene

import nsbench
from nsbench import solvers
from nsbench.solvers.base import grid

FOUND = Path(tempfile.gettempdir()) / "nsbench_honesty"
FEW = 3  # rounds of ever more samples; each is slower than the one before
FIXED = {
    "affine": "theta",
    "discs": "pbd",
    "links": "catching_up",
    "smooth": "pbd",
    "ode": "euler",
    "modes": "euler",
    "signs": "euler",
    "relay": "euler[implicit=true]",
    "circuit": "theta",
}


def held(text, family, specs):
    """Judges the scene of a case file; where it fails the file is kept, and the last one that
    hypothesis tries is the least."""
    FOUND.mkdir(exist_ok=True)
    path = FOUND / f"{family}.py"
    path.write_text(text, encoding="utf-8")
    judged = judge.Scene(nsbench.load_case(path))
    for spec in specs:
        verdict = judged.judge(spec)
        assert verdict.word not in ("wrong", "crash"), (
            f"{spec}: {verdict.why}; the case file is {path}"
        )


@pytest.mark.long
@pytest.mark.survives("silent wrong")
@settings(
    max_examples=6,
    deadline=None,
    derandomize=True,
    database=None,
    suppress_health_check=list(HealthCheck),
)
@given(st.data())
def test_what_says_ok_is_true(data):
    family = data.draw(st.sampled_from(sorted(FAMILIES)))
    text = scene(Choices(lambda n: data.draw(st.integers(0, n - 1))), family)
    held(text, family, ("event_driven", FIXED[family]))


def wall(**changes):
    """A point pushed against a floor, held and let go, of which nothing is known."""
    return nsbench.get_case("tide").replace(
        name="wall", exact=None, exact_impulse=None, exact_events=None, **changes
    )


LIES = {  # what a solver may tell of a true trajectory, and the word for it
    "a plateau": (
        lambda traj: {"x": traj.x + 1e-3 * (np.arange(len(traj.t)) > 2)[:, None]},
        "wrong",
    ),
    "not a number": (lambda traj: {"x": traj.x * np.nan}, "wrong"),
    "a pull": (
        lambda traj: {
            "impulse": -traj.impulse - np.arange(len(traj.t))[:, None] * (traj.impulse[-1] > 0)
        },
        "wrong",
    ),
    "an impulse that is lost": (
        lambda traj: {
            "contacts": (),
            "impulse": traj.impulse[:, :0],
            "reaction": 0.0 * traj.reaction,
        },
        "wrong",
    ),
    "a loud failure": (
        lambda traj: {"status": nsbench.solvers.Status("maxiter", "A sentence.")},
        "told",
    ),
    "nothing": (lambda traj: {}, "fine"),
}


@pytest.mark.long
@pytest.mark.parametrize("lie", LIES)
@pytest.mark.parametrize("spec", ["event_driven", "pbd"])
def test_a_lie_is_seen(lie, spec, monkeypatch):
    change, word = LIES[lie]
    case = wall()
    monkeypatch.setattr(own, "ROUNDS", FEW)
    true = judge.solvers.solve

    def lies(case, name, **accuracy):
        traj = true(case, name, **accuracy)
        lied = name == spec or (
            spec == "event_driven" and name.startswith("event_driven[max_steps=")
        )
        return dataclasses.replace(traj, **change(traj)) if lied else traj

    monkeypatch.setattr(judge.solvers, "solve", lies)
    assert judge.Scene(case).judge(spec).word == word


def test_a_crash_is_told_from_bad_input(monkeypatch):
    def crashes(case, name, **accuracy):
        return [][1]

    assert judge.Scene(wall()).judge("pbd").word == "fine"
    assert judge.Scene(wall(x0=np.array([-1.0]))).judge("pbd").word == "told"
    monkeypatch.setattr(judge.solvers, "solve", crashes)
    assert judge.Scene(wall()).judge("pbd").word == "crash"


@pytest.mark.parametrize("family", sorted(FAMILIES))
def test_a_scene_is_its_choices_and_shrinks(family):
    c = drawn(np.random.default_rng(3))
    text = scene(c, family)
    assert scene(replayed(c.made), family) == text

    def fails(made):
        return "xp.sin" in scene(replayed(made), family)

    least = shrunk(c.made, fails) if fails(c.made) else c.made
    assert not fails(c.made) or (fails(least) and len(scene(replayed(least), family)) <= len(text))


@pytest.mark.parametrize("spec", ["catching_up", "catching_up[nonlinear=true]", "euler"])
def test_steps_that_are_samples_are_no_more_between_uneven_ones(spec):
    """Else the loop takes as many as the smallest spacing asks for: minutes in Python."""
    case = wall(t=np.array([0.0, 1.0, 1.002, 2.5, 3.0]))
    grids = [(grid(t, h), len(t)) for h, t in own._fine(case, spec, solvers.get(spec))]
    assert grids and all(g.aligned and g.substeps.max() == 1 and len(g.t) == n for g, n in grids)
    assert max(n for _, n in grids) <= own.NODES + 1


def jumps(xp):
    return lambda t, x: xp.where(t < 1.373, -1.0, 2.0) + 0.0 * x


@pytest.mark.parametrize(
    "drift, size",
    [
        (lambda xp, t: xp.where(t < 1.373, -1.0, 2.0) + xp.sin(9.0 * t), 3.0),
        (lambda xp, t: xp.where(t < 1.0, -1.0, 2.0), 3.0),
        (lambda xp, t: 1.0 / (t - 1.373), 0.0),
        (lambda xp, t: xp.sqrt(1.373 - t), 0.0),
        (lambda xp, t: xp.tanh(1e6 * (t - 1.373)), 0.0),
        (lambda xp, t: abs(t - 1.373), 0.0),
    ],
    ids=["jump", "at a sample", "pole", "root", "steep", "kink"],
)
def test_jumps_of_a_drift_in_time_are_told_from_what_is_steep(drift, size):
    """In a step with a jump a true run may be off by jump x h, and no ladder tells a constant."""
    case = wall(problem=nsbench.Complementarity(lambda xp: lambda t, x: drift(xp, t) + 0.0 * x))
    answer = nsbench.solve(wall(), "pbd", h=0.1)
    assert abs(ladder.jumps(case, answer) - size) < 1e-9


@pytest.mark.long
@pytest.mark.parametrize("off, word", [(0.5, "fine"), (10.0, "wrong")])
def test_a_jump_excuses_its_part_of_a_step_alone(off, word, monkeypatch):
    case = wall(problem=nsbench.Complementarity(jumps, wall().problem.constraints))
    true = judge.attempt
    finest = min(ladder.values(case, "pbd", solvers.get("pbd"), ladder.LADDER))

    def lied(case, spec, value):
        out = true(case, spec, value)
        if spec == "pbd":
            late = (np.arange(len(out.traj.t)) > 3)[:, None]
            out.traj = dataclasses.replace(out.traj, x=out.traj.x + 3.0 * off * finest * late)
        return out

    monkeypatch.setattr(judge, "attempt", lied)
    assert judge.Scene(case).judge("pbd").word == word


def test_the_second_integrator_is_judged_where_the_first_is_known_not_to_end():
    spec = judge.Scene(wall(), 0).second[0]
    assert judge.Scene(wall(), 0, answered=False).judge(spec).word == "own"


@pytest.mark.long
def test_samples_that_were_asked_for_are_not_run_again(monkeypatch):
    asked = []
    attempt = judge.attempt

    def counted(case, spec, value):
        asked.append((spec, case.t.tobytes(), case.x0.tobytes()))
        out = attempt(case, spec, value)
        out.measured["residual"] = 1.0  # which no number of samples brings down
        return out

    monkeypatch.setattr(judge, "attempt", counted)
    case = wall(problem=nsbench.Complementarity(jumps, wall().problem.constraints))
    assert judge.Scene(case).judge("event_driven").word == "fine"
    assert len(asked) > 1 and len(set(asked)) == len(asked)


def far(xp):
    """At rest, forgetful at first and repelled later, a long way from the origin."""
    return lambda t, x: xp.where(t < 2.0, -20.0, 2.0) * (x - 1e8) + 0.0 * t


def test_roundings_far_from_the_origin_grow_at_all_times():
    case = nsbench.Case(
        name="far",
        problem=nsbench.Complementarity(far),
        x0=np.array([1e8 + 1.0]),
        t=np.linspace(0.0, 5.0, 16),
    )
    judged = judge.Scene(case)
    assert judged.condition < 2.0 and judged.growth > 10.0  # a nudge of the size of roundings
    run = judged.first.traj
    assert judged.apart(dataclasses.replace(run, x=run.x + 10.0 * judged.round_off), run) == 0.0
    assert judge.Scene(wall()).growth == 1.0
    assert judge.Scene(case.replace(t=np.array([0.0, 3.0]))).growth >= 1.0  # no sample between


@pytest.mark.long
@pytest.mark.parametrize("speed, word", [(1.0, "wrong"), (1e9, "open")])
def test_steps_in_which_the_drift_leaps_over_a_particle_show_no_order(speed, word, monkeypatch):
    case = nsbench.get_case("two_discs").replace(exact=None, exact_impulse=None, exact_events=None)
    true = judge.attempt

    def lied(case, spec, value):
        out = true(case, spec, value)
        if spec == "pbd":
            out.traj = dataclasses.replace(
                out.traj, x=out.traj.x + 0.5 * (np.arange(len(out.traj.t)) > 2)[:, None]
            )
        return out

    monkeypatch.setattr(judge, "attempt", lied)
    monkeypatch.setattr(judge, "largest_speed", lambda problem, t, x: speed)
    assert judge.Scene(case).judge("pbd").word == word
