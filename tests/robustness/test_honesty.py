"""Nothing wrong is called ok: neither a drift that raises, nor a solver that lies, nor a closed
form that is false."""

import numpy as np
import pytest

import nsbench
from nsbench.cli import main
from nsbench.cli.check import check_case
from nsbench.study.result_contract import contract_violation
from nsbench.trajectory import Status, Trajectory


def raises_late(xp):
    def f(t, y):
        if t > 1.0:
            raise RuntimeError("on purpose")
        return -y

    return f


@pytest.mark.survives("silent wrong")
@pytest.mark.parametrize("spec", ["pbd", "catching_up"])
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_a_drift_that_raises_in_compiled_code_is_a_failure(spec):
    case = nsbench.get_case("tide").replace(
        problem=nsbench.Complementarity(raises_late, (nsbench.Affine(np.eye(1), np.zeros(1)),)),
        exact=None,
        exact_impulse=None,
    )
    traj = nsbench.solve(case, spec, h=0.05)
    assert traj.status.code == "nan" and np.isnan(traj.x[-1]).all()


@pytest.mark.survives("ok is finite", "float32")
def test_what_a_solver_says_is_not_taken_for_granted():
    case = nsbench.get_case("tide")
    k = len(case.t)
    none = np.zeros((k, 0))
    x = case.exact(case.t)
    good = Trajectory(case.t, x, (), none, none)
    assert contract_violation(case, good) == ""
    assert (
        contract_violation(
            case, Trajectory(case.t, x * np.nan, (), none, none, Status("nan", "A sentence."))
        )
        == ""
    )
    for bad, word in (
        (None, "NoneType"),
        (Trajectory(case.t, x, (), none, none, "ok"), "status"),
        (Trajectory(case.t, x * np.nan, (), none, none), "finite"),
        (Trajectory(case.t, x[1:], (), none, none), "shape"),
        (Trajectory(case.t, x.astype(np.float32), (), none, none), "float32"),
        (Trajectory(case.t, x, ((0, 0),), none, none), "impulse"),
        (Trajectory(case.t, x, (), none, none, lam_time="=cmd()"), "lam_time"),
        (Trajectory(case.t, x, (), none, none, lam_time=[]), "lam_time"),
    ):
        assert word in contract_violation(case, bad)


@pytest.mark.parametrize(
    "change, word",
    [
        ({"exact_impulse": lambda t: 0.5 * tide.exact_impulse(t)}, "exact_impulse"),
        ({"exact_impulse": lambda t: np.hstack([tide.exact_impulse(t)] * 3)}, "shape"),
        ({"exact": lambda t: tide.exact(t) + 1e-6 * (t > 1.0)[:, None]}, "exact(t)"),
        ({"exact_events": (0.9, 2.5)}, "exact_events"),
    ],
)
def test_check_notices_a_false_closed_form(change, word):
    found = check_case(tide.replace(**change), lambda text: None)
    assert any(word in sentence for sentence in found), found


def test_check_is_content_with_a_true_one():
    assert check_case(tide, lambda text: None) == []


tide = nsbench.get_case("tide")


@pytest.mark.parametrize(
    "text",
    [
        "1/0",
        "raise RuntimeError('x')",
        "def (",
        "CASE = 5",
        "import sys; sys.exit(0)",
        "def make():\n    return {}['a']",
    ],
)
def test_check_says_what_a_broken_file_raises(tmp_path, capsys, text):
    (tmp_path / "f.py").write_text(text)
    assert main(["check", str(tmp_path / "f.py")]) == 3
    assert "not met" in capsys.readouterr().out


@pytest.mark.survives("errors that grow")
def test_an_error_that_grows_again_is_no_plateau():
    h = 0.1 / np.unique(np.round(2 ** np.arange(0, 8, 0.3)))
    for err in (h + 1e-5 / h, h + 1e-6 / h):
        assert nsbench.fit_order(h, err).verdict not in ("plateau", "order")


@pytest.mark.parametrize(
    "args", [["-j", "0"], ["-j", "-1"], ["--timeout", "0"], ["--timeout", "nan"], ["--h", ""]]
)
def test_settings_that_make_no_sense_are_refused(args, capsys):
    assert main(["run", "tide", "-s", "pbd", *args]) == 2
