"""Whatever a drift returns, a run ends with a row that says what became of it, or is refused before
it starts."""

import numpy as np
import pytest
from survive_files import case_file, refused_before, rows

from nsbench import load_case

LATE = "xp.where(t > 0.5499, {}, -0.1) * xp.ones_like(x)"


@pytest.mark.long
@pytest.mark.survives("nan at the start")
@pytest.mark.parametrize(
    "problem",
    [
        None,
        "Complementarity(drift, ())",
        "Filippov({(1,): drift, (-1,): drift}, lambda xp: lambda t, x: x - 0.5)",
    ],
)
def test_nan_at_the_start_is_a_row(tmp_path, problem):
    found = rows(
        case_file(tmp_path, "xp.nan * x", problem=problem),
        ("pbd", "event_driven", "euler", "penalty", "kdtree"),
    )
    assert len(found) >= 2 and {r["status"] for r in found.values()} == {"nan"}


@pytest.mark.long
@pytest.mark.survives("nan later")
def test_nan_on_the_way_is_a_row_with_the_time(tmp_path):
    found = rows(case_file(tmp_path, LATE.format("xp.nan")))
    assert len(found) == 6 and {r["status"] for r in found.values()} == {"nan"}
    assert all("t = 0.5" in r["why"] for r in found.values()), found


@pytest.mark.long
@pytest.mark.survives("infinite drift")
@pytest.mark.parametrize("drift", ["xp.inf + 0 * x", LATE.format("-xp.inf"), LATE.format("xp.inf")])
def test_an_infinite_drift_is_a_row(tmp_path, drift):
    found = rows(case_file(tmp_path, drift))
    assert len(found) == 6
    assert all(r["status"] in ("nan", "diverged") and "t = " in r["why"] for r in found.values()), (
        found
    )


@pytest.mark.long
@pytest.mark.survives("blow-up")
@pytest.mark.parametrize("drift", ["x * x", "x**3"])
def test_a_solution_that_leaves_every_bound_has_diverged(tmp_path, drift):
    """Implicit steps lose their solution before: theta says so, and never that it is well."""
    found = {m: r["status"] for m, r in rows(case_file(tmp_path, drift)).items()}
    assert found.pop("theta") in ("infeasible", "diverged", "maxiter")
    assert len(found) == 5 and set(found.values()) == {"diverged"}, found


@pytest.mark.survives("blow-up")
def test_steps_of_the_host_loops_that_blow_up_have_diverged(tmp_path):
    smooth = "Smooth(lambda xp: lambda t, x: 1.0 * x),"
    found = rows(
        case_file(tmp_path, "x * x", smooth),
        ("pbd", "catching_up", "richardson", "catching_up[backend=piqp]"),
    )
    assert len(found) == 4 and {r["status"] for r in found.values()} == {"diverged"}, found


@pytest.mark.parametrize(
    "drift, said",
    [
        pytest.param("xp.ones(2)", "(2,)", marks=pytest.mark.survives("shape of the drift")),
        pytest.param("1.0", "()", marks=pytest.mark.survives("shape of the drift")),
        pytest.param(
            "np.ones(len(x), int)", "int64", marks=pytest.mark.survives("type of the drift")
        ),
        pytest.param("1j * x", "complex128", marks=pytest.mark.survives("type of the drift")),
        pytest.param("x.astype(np.float32)", "float32", marks=pytest.mark.survives("float32")),
        pytest.param("x.__iadd__(1.0) - 3.0", "in place", marks=pytest.mark.survives("in place")),
    ],
)
def test_a_drift_of_another_kind_is_an_error_before_anything_runs(tmp_path, capsys, drift, said):
    path = case_file(tmp_path, drift)
    assert said in refused_before(path, tmp_path, capsys)
    with pytest.raises((ValueError, TypeError)) as e:
        load_case(path)
    assert said in str(e.value)


@pytest.mark.survives("in place")
def test_a_drift_that_writes_into_the_state_later_on_is_an_error_row(tmp_path):
    path = case_file(tmp_path, "late(t, x) - 1.0")
    late = (
        "def late(t, x):\n    if t > 0.5:\n        x[0] = 0.25\n    return 0.0 * x\n\n\ndef drift("
    )
    path.write_text(path.read_text().replace("def drift(", late))
    found = rows(path, ("pbd", "catching_up", "kdtree", "event_driven", "theta"))
    assert len(found) == 5 and all(r["status"] in ("error", "nan") for r in found.values()), found


@pytest.mark.survives("float32")
@pytest.mark.parametrize(
    "change",
    [
        {"x0": "np.ones(1, np.float32)"},
        {"t": "np.linspace(0, 2, 11, dtype=np.float32)"},
        {"constraints": "Affine(np.eye(1, dtype=np.float32), np.zeros(1)),"},
        {"constraints": "Affine(np.eye(1), np.zeros(1, np.float32)),"},
        {"constraints": "Affine(np.eye(1), lambda xp: lambda t: np.zeros(1, np.float32)),"},
        {"constraints": "Smooth(lambda xp: lambda t, x: x.astype(np.float32)),"},
        {
            "constraints": "Distance(1.0, anchors=lambda xp: lambda t: np.zeros((1, 1), "
            "np.float32), dim=1),"
        },
        {
            "problem": "Filippov({(1,): drift, (-1,): lambda xp: lambda t, x: np.float32(1) * "
            "x.astype(np.float32)}, "
            "lambda xp: lambda t, x: x - 9.0)"
        },
        {
            "problem": "Filippov({(1,): drift, (-1,): drift}, lambda xp: lambda t, x: "
            "x.astype(np.float32))"
        },
        {
            "problem": "Filippov.relay(drift, np.ones((1, 1), np.float32), lambda xp: lambda t, "
            "x: x + 0.0)"
        },
        {"constraints": "Distance(radii=np.ones(2, np.float32), dim=1),", "x0": "[0.0, 4.0]"},
        {"constraints": "Distance(np.float32(1.0), dim=1),", "x0": "[0.0, 4.0]"},
        {"constraints": "Distance(1.0, anchors=np.full((1, 1), -4, np.float32), dim=1),"},
        *(
            {
                "problem": "LCS("
                + ", ".join(f"np.eye(1, dtype=np.float{32 if m == k else 64})" for m in range(4))
                + ")"
            }
            for k in range(4)
        ),
        {"more": "exact=lambda t: np.ones((len(t), 1), np.float32)"},
        {"more": "exact_impulse=lambda t: np.ones((len(t), 1), np.float32)"},
    ],
)
def test_single_precision_is_an_error_wherever_it_stands(tmp_path, capsys, change):
    path = case_file(tmp_path, **change)
    assert "float32" in refused_before(path, tmp_path, capsys)
    with pytest.raises((ValueError, TypeError), match="float32"):
        load_case(path)


@pytest.mark.survives("float32")
def test_a_closed_form_in_single_precision_cannot_come_in_by_another_way(tmp_path):
    case = load_case(case_file(tmp_path))
    for name in ("exact", "exact_impulse"):
        with pytest.raises(TypeError, match=f"{name} .*float32"):
            case.replace(**{name: lambda t: np.ones((len(t), 1), np.float32)})
