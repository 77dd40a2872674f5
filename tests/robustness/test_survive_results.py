"""What a solver returns is checked, and never stands for what the bench measures."""

from dataclasses import replace

import numpy as np
import pytest
from still_solver import solver
from survive_files import METHODS

import nsbench
from nsbench import solvers
from nsbench.study.result_contract import contract_violation
from nsbench.trajectory import STATUSES, Status, Trajectory


@pytest.mark.survives("ok is finite", "own residuals")
def test_a_solver_cannot_speak_for_the_bench(tmp_path):
    """Whatever it counts, the columns of the bench are those of the bench."""
    from nsbench.study import Spec
    from nsbench.study.attempt import attempt

    lies = {
        "state_sup": 0.0,
        "residual": 0.0,
        "feasibility": 0.0,
        "status": "ok",
        "case": "other",
        "seconds": 0.0,
        "asked": 7.0,
        "why": "trust me",
        "solver": "other",
        "reference": "exact",
        "setup_seconds": -1.0,
        "rounds": 99,
        "mine": 5,
        "read": 5,
        "unlike": "all",
        "shared": True,
        "limit": 1e9,
        "warnings": 7,
    }
    path = solver(tmp_path, "liar", stats=repr(lies))
    row = attempt(Spec("tide", "liar", "h", 0.1, "", (str(path),)))[0]
    assert (
        row["case"] == "tide"
        and row["solver"] == "liar"
        and row["asked"] == 0.1
        and row["why"] == ""
        and row["mine"] == 5
    )
    assert row["state_sup"] > 0.4 and row["residual"] > 0.4
    assert row["seconds"] > 0 and row["setup_seconds"] >= 0 and row["rounds"] < 99
    assert not {"read", "unlike", "shared", "limit", "warnings"} & row.keys()


@pytest.mark.survives("ok is finite")
@pytest.mark.parametrize(
    "change, word",
    [
        ({"t": lambda t: t[:-1], "x": lambda x: x[:-1]}, "times"),
        ({"x": lambda x: x[:-1]}, "shape"),
        ({"x": lambda x: np.where(x > 0.4, np.nan, x)}, "not finite"),
        ({"x": lambda x: np.where(x > 0.4, np.inf, x)}, "not finite"),
        ({"t": lambda t: 0.5 * t}, "times"),
        ({"x": lambda x: x.astype(np.float32)}, "float32"),
        ({"x": lambda x: x.astype(complex)}, "complex"),
        ({"reaction": lambda r: r + np.nan}, "reaction"),
        ({"reaction": lambda r: r[:-1]}, "reaction"),
    ],
)
def test_a_row_that_says_ok_and_has_not_reached_its_end_is_an_error(change, word):
    case = nsbench.get_case("tide")
    good = nsbench.solve(case, "pbd", h=0.05)
    parts = {
        n: change.get(n, lambda v: v)(getattr(good, n))
        for n in ("t", "x", "contacts", "impulse", "reaction")
    }
    assert contract_violation(case, good) == "" and word in contract_violation(
        case, Trajectory(**parts)
    )


@pytest.mark.survives("ok is finite")
@pytest.mark.parametrize("value", [np.inf, -np.inf, np.float64(np.inf), 10**400])
def test_a_count_that_is_infinite_is_an_error(value):
    """The report writes counts as whole numbers."""
    case = nsbench.get_case("tide")
    good = nsbench.solve(case, "pbd", h=0.05)
    counted = replace(good, stats=good.stats | {"drift_calls": value})
    assert "drift_calls" in contract_violation(case, counted)
    unknown = replace(good, stats=good.stats | {"drift_calls": np.nan})
    assert contract_violation(case, unknown) == ""


@pytest.mark.long
@pytest.mark.survives("closed list")
def test_every_status_is_one_of_the_list():
    for code in STATUSES:
        assert Status(code, "A sentence.").code == code
    for code in ("OK", "good", "", None, "ok "):
        with pytest.raises((ValueError, TypeError)):
            Status(code)
    for spec in METHODS:
        for name in ("tide", "sliding", "hex", "inconsistent", "spiral", "rlc_diode"):
            traj = nsbench.solve(name, spec)
            assert traj.status.code in STATUSES and (
                traj.status.ok or len(str(traj.status).split()) > 4
            )


@pytest.mark.long
@pytest.mark.survives("same bytes")
@pytest.mark.parametrize("spec", METHODS)
def test_a_run_repeated_gives_the_same_bytes(spec):
    for name in ("tide", "three_discs"):
        if solvers.get(spec).refuses(nsbench.get_case(name)) is None:
            a = nsbench.solve(name, spec)
            b = nsbench.solve(nsbench.get_case(name), spec)
            for part in ("t", "x", "impulse", "reaction"):
                assert getattr(a, part).tobytes() == getattr(b, part).tobytes(), (spec, name, part)
            told = [repr(nsbench.errors(nsbench.get_case(name), traj)) for traj in (a, b)]
            assert told[0] == told[1]
