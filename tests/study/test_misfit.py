"""A run that says ok began where its case starts, and took the steps that it was asked for."""

import numpy as np
import pytest
from solver_file import solver
from survive_files import case_file, rows

import nsbench
from nsbench.study import Spec
from nsbench.study.attempt import attempt
from nsbench.study.result_contract import contract_violation
from nsbench.trajectory import Status, Trajectory

METHODS = (
    "pbd",
    "pbd_jax",
    "kdtree",
    "catching_up",
    "theta",
    "penalty",
    "event_driven",
    "solve_ivp",
    "nosnoc",
    "richardson",
    "euler",
    "penalty[extrapolate=1]",
)
DISCS = {"drift": "-x", "constraints": "Distance(2.0),"}


def stays(case, x, **stats):
    """A run that stays at x (n,) and says ok."""
    k = len(case.t)
    return Trajectory(
        case.t,
        np.tile(np.asarray(x, float), (k, 1)),
        (),
        np.zeros((k, 0)),
        np.zeros((k, case.n)),
        stats=stats,
    )


@pytest.mark.survives("another start")
@pytest.mark.parametrize("start", ["error", "keep", "project"])
def test_a_run_that_begins_elsewhere_is_an_error(tmp_path, start):
    case = nsbench.load_case(
        case_file(
            tmp_path,
            x0="[1.0, -3.0]",
            constraints="Affine(np.eye(2)[:1], np.zeros(1)),",
            more=f"start={start!r}",
        )
    )
    for x, fits in (
        ([1.0, -3.0], True),
        ([1.0, -3.0 * (1 + 2e-13)], True),
        ([1.0 + 1e-10, -3.0], False),
        ([5.0, -3.0], False),
    ):
        assert (contract_violation(case, stays(case, x)) == "") == fits, x
    assert "begins with 5 in coordinate 0" in contract_violation(case, stays(case, [5.0, -3.0]))
    assert (
        contract_violation(
            case,
            Trajectory(
                case.t,
                0 * case.t[:, None],
                (),
                np.zeros((11, 0)),
                np.zeros((11, 1)),
                Status("nan", "A sentence."),
            ),
        )
        == ""
    )


@pytest.mark.survives("another start")
def test_a_projected_start_is_feasible(tmp_path):
    path = case_file(tmp_path, **DISCS, x0="[0.0, 0, 1, 0]", more='start="project"')
    case = nsbench.load_case(path)
    assert contract_violation(case, stays(case, [-0.5, 0, 1.5, 0])) == ""
    assert "violates a constraint by 1" in contract_violation(case, stays(case, case.x0))
    assert "violates a constraint by 0.0" in contract_violation(
        case, stays(case, [-0.5, 0, 1.49, 0])
    )


@pytest.mark.survives("another start")
def test_a_row_of_a_run_that_begins_elsewhere_has_no_numbers(tmp_path):
    """Nothing is known of the solution but its equation, which such a run may well meet."""
    path = tmp_path / "shifty.py"
    path.write_text(solver("nonlocal case\ncase = case.replace(x0=np.full(1, 5.0))"))
    case = case_file(
        tmp_path, "0.0 * x", x0="[1.0]", constraints="", problem="Complementarity(drift, ())"
    )
    row, run = attempt(Spec("scene", "shifty", "h", 0.1, str(case), (str(path),)))
    assert (
        row["status"] == "error"
        and "begins with 5" in row["why"]
        and run is None
        and "residual" not in row
    )


@pytest.mark.survives("another step")
@pytest.mark.parametrize(
    "stats, fits",
    [
        ({}, True),
        ({"h": 0.1}, True),
        ({"h": 0.1, "steps": 20}, True),
        ({"h": 0.05}, True),
        ({"h": np.float32(0.0625)}, True),
        ({"h": 1e-30}, False),
        ({"h": 0.048}, False),
        ({"h": 0.1001}, False),
        ({"h": -0.1}, False),
        ({"h": np.nan}, False),
        ({"h": np.inf}, False),
        ({"h": "0.1"}, False),
        ({"h": None}, False),
        ({"h": 0.1, "steps": 19}, False),
        ({"h": 0.1, "steps": np.nan}, False),
        ({"h": 0.1, "steps": "20"}, False),
        ({"h": 0.1, "steps": 60}, True),
    ],
)
def test_steps_are_those_that_were_asked_for(tmp_path, stats, fits):
    case = nsbench.load_case(case_file(tmp_path, "0.0 * x"))
    found = contract_violation(case, stays(case, case.x0, **stats), "h", 0.1)
    assert (found == "") == fits, found
    assert (
        contract_violation(case, stays(case, case.x0, **stats), "k", 0.1) == ""
    )  # of a stiffness it is the bench that tells


@pytest.mark.survives("another step", "step beyond the end")
def test_a_step_longer_than_the_run_is_as_long_as_the_run(tmp_path):
    case = nsbench.load_case(case_file(tmp_path, "0.0 * x"))
    assert contract_violation(case, stays(case, case.x0, h=2.0, steps=1), "h", 100.0) == ""
    assert "do not cover" in contract_violation(
        case, stays(case, case.x0, h=1.9, steps=1), "h", 100.0
    )


@pytest.mark.long
@pytest.mark.survives("infeasible start", "another start", "another step")
@pytest.mark.parametrize("start", ["feasible", "keep", "project"])
def test_every_method_of_the_package_begins_where_its_case_starts(tmp_path, start):
    """Two discs, apart, overlapping and kept or projected; steps that fit between samples and one
    that does not."""
    more = {} if start == "feasible" else {"more": f"start={start!r}"}
    path = case_file(
        tmp_path,
        **DISCS,
        x0="[0.0, 0, 3, 0.1]" if start == "feasible" else "[0.0, 0, 1, 0.1]",
        name=start,
        **more,
    )
    for accuracy in (0.03, 0.7):
        for spec, row in rows(path, METHODS, h=accuracy).items():
            assert row["status"] != "error", (spec, accuracy, row["why"])


@pytest.mark.parametrize(
    "name, value", [("contacts", None), ("stats", None), ("contacts", np.zeros(2)), ("stats", [])]
)
def test_what_is_no_trajectory_inside_is_told(name, value):
    case = nsbench.get_case("tide")
    parts = {"contacts": (), "stats": {}} | {name: value}
    traj = Trajectory(
        case.t, case.exact(case.t), impulse=np.zeros((61, 0)), reaction=np.zeros((61, 1)), **parts
    )
    assert name in contract_violation(case, traj) and type(value).__name__ in contract_violation(
        case, traj
    )
