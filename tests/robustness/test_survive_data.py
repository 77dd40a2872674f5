"""Numbers that make no sense are an error before anything runs, and the message holds the
number."""

import numpy as np
import pytest
from survive_files import case_file, refused_before

import nsbench
from nsbench.cli import main
from nsbench.solvers import get, solve

DISCS = {"drift": "-x", "x0": "[0.0, 0, 4, 0]"}


@pytest.mark.parametrize(
    "change, said",
    [
        pytest.param(
            {"x0": "[float('nan')]"}, "nan", marks=pytest.mark.survives("start not finite")
        ),
        pytest.param(
            {"x0": "[-float('inf')]"}, "-inf", marks=pytest.mark.survives("start not finite")
        ),
        pytest.param({"t": "[0.0, 0.0]"}, "0, 0", marks=pytest.mark.survives("no time")),
        pytest.param({"t": "[0.0]"}, "two times", marks=pytest.mark.survives("no time")),
        pytest.param({"t": "[0.0, -1.5]"}, "-1.5", marks=pytest.mark.survives("time backwards")),
        pytest.param({"t": "[0.0, 1.0, 0.5]"}, "0.5", marks=pytest.mark.survives("time backwards")),
        pytest.param(
            {**DISCS, "constraints": "Distance(0.0),"},
            "d contains 0.0",
            marks=pytest.mark.survives("radius no length"),
        ),
        pytest.param(
            {**DISCS, "constraints": "Distance(-2.0),"},
            "-2.0",
            marks=pytest.mark.survives("radius no length"),
        ),
        pytest.param(
            {**DISCS, "constraints": "Distance(radii=[1.0, float('nan')]),"},
            "nan",
            marks=pytest.mark.survives("radius no length"),
        ),
        pytest.param(
            {**DISCS, "constraints": "Distance(radii=[1.0, 0.0]),"},
            "radii contains 0.0",
            marks=pytest.mark.survives("radius no length"),
        ),
        pytest.param(
            {"x0": "[]", "constraints": "Distance(2.0),"},
            "empty",
            marks=pytest.mark.survives("few particles"),
        ),
    ],
)
def test_data_that_makes_no_sense_is_an_error(tmp_path, capsys, change, said):
    path = case_file(tmp_path, **change)
    assert said in refused_before(path, tmp_path, capsys)
    with pytest.raises((ValueError, TypeError)) as e:
        nsbench.load_case(path)
    assert said in str(e.value)


@pytest.mark.parametrize(
    "name, solver, value, said",
    [
        *(
            pytest.param("h", "pbd", v, v, marks=pytest.mark.survives("step no number"))
            for v in ("0", "-0.5", "nan", "inf")
        ),
        *(
            pytest.param("tol", "event_driven", v, v, marks=pytest.mark.survives("step no number"))
            for v in ("0", "-1", "nan", "inf")
        ),
        *(
            pytest.param("h", solver, v, v, marks=pytest.mark.survives("step no number"))
            for solver in ("theta", "euler", "kdtree")
            for v in ("0", "-0.5", "nan", "inf")
        ),
        *(
            pytest.param(
                "k",
                "penalty",
                v,
                v,
                marks=pytest.mark.survives("stiffness no number", "step no number"),
            )
            for v in ("0", "-3", "nan", "inf")
        ),
        pytest.param(
            "h", "pbd", "1e-17", "1e-17", marks=pytest.mark.survives("step below rounding")
        ),
        pytest.param(
            "h",
            "catching_up",
            "0.1,1e-15",
            "1e-15",
            marks=pytest.mark.survives("step below rounding"),
        ),
    ],
)
def test_accuracies_that_make_no_sense_are_errors(tmp_path, capsys, name, solver, value, said):
    out = tmp_path / "never"
    assert main(["run", "tide", "-s", solver, f"--{name}={value}", "-o", str(out)]) == 2
    said_there = capsys.readouterr().err
    assert f"{float(said):g}" in said_there or said in said_there
    assert not out.exists()
    with pytest.raises(ValueError):
        solve("tide", solver, **{name: float(value.split(",")[-1])})


@pytest.mark.survives("step below rounding")
def test_a_step_below_the_rounding_of_late_times_is_an_error(tmp_path, capsys):
    path = case_file(tmp_path, t="1e10 + np.linspace(0, 2, 11)")
    assert "rounding of t = 1e+10" in refused_before(path, tmp_path, capsys, "--h", "1e-7")
    with pytest.raises(ValueError, match="rounding"):
        solve(nsbench.load_case(path), "pbd", h=1e-7)


@pytest.mark.survives("step beyond the end")
@pytest.mark.parametrize("solver", ["pbd", "catching_up", "theta", "kdtree"])
def test_a_step_beyond_the_end_is_one_step_and_says_so(solver):
    case = nsbench.get_case("tide")
    traj = solve(case, solver, h=50.0)
    assert traj.status.ok and traj.stats["steps"] == 1 and traj.stats["h"] == case.t[-1]
    row = nsbench.run("tide", solver, h=50.0).rows[0]
    assert row["asked"] == 50.0 and row["h"] == case.t[-1] and row["steps"] == 1


@pytest.mark.survives("stiffness 1e16")
def test_a_penalty_that_is_too_stiff_is_a_row_with_the_reason():
    row = nsbench.run("tide", "penalty[max_steps=2000]", k=1e16).rows[0]
    assert row["status"] in ("maxiter", "diverged") and len(row["why"].split()) > 5
    assert np.isnan(row["state_sup"])


@pytest.mark.long
@pytest.mark.survives("stiff and explicit")
def test_explicit_steps_beyond_the_limit_of_stability_diverge(tmp_path):
    """x' = -1e4 (x - cos t): h k = 100."""
    case = nsbench.load_case(
        case_file(tmp_path, "-1e4 * (x - xp.cos(t))", "Affine(np.eye(1), 1e300 * np.ones(1)),")
    )
    for solver in ("pbd", "catching_up"):
        assert solve(case, solver, h=0.01).status.code == "diverged"
    free = case.replace(problem=nsbench.Complementarity(case.problem.drift, ()))
    assert solve(free, "euler", h=0.01).status.code == "diverged"


@pytest.mark.long
@pytest.mark.survives("stiff and explicit")
@pytest.mark.parametrize("rate", [210.0, 250.0, 400.0, 900.0])
def test_what_overshoots_is_not_ok_because_the_end_comes_before_infinity(tmp_path, rate):
    """x' = -rate (x - cos t) from 0.5 with h = 0.01 up to t = 2: grows by (rate h - 1)^200, from
    1e8 to beyond 1e150."""
    case = nsbench.load_case(
        case_file(tmp_path, f"-{rate} * (x - xp.cos(t))", "Affine(np.eye(1), 1e300 * np.ones(1)),")
    )
    free = case.replace(problem=nsbench.Complementarity(case.problem.drift, ()))
    for where, solver in ((case, "pbd"), (case, "catching_up"), (free, "euler")):
        assert solve(where, solver, h=0.01).status.code == "diverged"
        assert solve(where, solver, h=0.9 / rate).status.ok
    assert solve(free, "euler[implicit=true]", h=0.01).status.ok


def test_what_grows_because_it_should_is_ok():
    """x' = 30 x, and an ellipse whose long axis is 1e5 times the short one, past its tip."""
    steep = nsbench.Case(
        "steep",
        nsbench.Complementarity(lambda xp: lambda t, x: 30.0 * x, ()),
        np.ones(1),
        np.linspace(0, 1, 9),
    )
    turning = nsbench.Case(
        "turning",
        nsbench.Complementarity(lambda xp: lambda t, x: xp.stack((-1e5 * x[1], 1e-5 * x[0])), ()),
        np.array([0.0, -1.0]),
        np.linspace(0.0, 2.0, 5),
    )
    for case in (steep, turning):
        assert solve(case, "euler", h=0.01).status.ok


def test_the_least_step_is_taken():
    """One more digit, and the same step is refused: the limit is at rounding, not well above."""
    case = nsbench.get_case("tide").replace(t=np.array([0.0, 3e-9]), exact=None, exact_impulse=None)
    assert get("pbd").prepare(case, 1e-16) is not None
