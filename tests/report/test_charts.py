"""Charts with their data: the same bytes twice without a browser, nothing lost, nothing imported
before it is needed."""

import json
import subprocess
import sys

import numpy as np
import pytest
from report_rows import STEPS, made, row

import nsbench
from nsbench.report import data
from nsbench.report.charts import bar_texts, files, layouts, studies

TIDE = [r for r in made() if r["case"] == "tide"]
CHARTS = {
    "work_precision": lambda: studies.work_precision(TIDE),
    "error_against_step": lambda: studies.error_against_step(TIDE, metric="force"),
    "orders": lambda: studies.orders(TIDE),
}


def points(spec):
    return spec["datasets"]["points"]


@pytest.mark.long
@pytest.mark.parametrize("name", CHARTS)
def test_a_chart_has_the_same_bytes_twice_as_svg_pdf_and_json(name, tmp_path):
    for suffix in files.FORMATS:
        one = files.write_chart(CHARTS[name](), tmp_path / f"one{suffix}").read_bytes()
        other = files.write_chart(CHARTS[name](), tmp_path / f"other{suffix}").read_bytes()
        assert one == other and len(one) > 1000, suffix
    with pytest.raises(ValueError, match=".svg, .pdf, .json"):
        files.write_chart(CHARTS[name](), tmp_path / "chart.bmp")


def test_every_run_is_in_the_chart_of_its_case():
    """Zeros and failures have kinds of their own; a refusal is no failure."""
    rows = [row("a", "pbd", float(h), state_sup=float(h)) for h in STEPS]
    rows[-1]["state_sup"] = 0.0
    rows[0] |= {"status": "diverged", "why": "The state left all bounds.", "state_sup": np.nan}
    rows[1] |= {"status": "refused", "why": "Not for this case.", "state_sup": np.nan}
    found = points(studies.error_against_step(rows))
    kinds = [p["kind"] for p in found]
    assert kinds.count("zero") == 1 and kinds.count("failed") == 1
    assert kinds.count("error") == len(rows) - 3
    assert [p["why"] for p in found if p["kind"] == "failed"] == ["The state left all bounds."]
    errors = {p["h"]: p["y"] for p in found if p["kind"] == "error"}
    assert all(errors[h] == h for h in errors)


def test_a_trajectory_is_charted_by_coordinate_and_by_contact():
    traj = nsbench.solve("tide", "event_driven")
    state = points(studies.trajectory(traj))
    assert [p["y"] for p in state] == traj.x[:, 0].tolist()
    impulse = points(studies.trajectory(traj, "impulse"))
    assert impulse[-1]["y"] == traj.impulse[-1, 0]
    assert impulse[-1]["series"] == str(traj.contacts[0])
    with pytest.raises(ValueError, match="state or impulse"):
        studies.trajectory(traj, "velocity")


def test_a_case_or_metric_that_is_not_there_is_named():
    with pytest.raises(ValueError, match="which case.*tide"):
        studies.work_precision(made(), "nowhere")
    with pytest.raises(ValueError, match="no metric 'speed'"):
        studies.work_precision(TIDE, metric="speed")


def test_building_a_chart_imports_no_renderer():
    code = (
        "import sys; from nsbench.report.charts.studies import work_precision\n"
        "work_precision([{'case': 'a', 'solver': 'pbd', 'h': 0.1, 'state_sup': 0.1, "
        "'seconds': 1.0, 'status': 'ok'}])\n"
        "assert not {'vl_convert', 'matplotlib', 'jax', 'numba'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_layouts_hold_no_data():
    spec = studies.orders(TIDE)
    assert json.dumps(spec, allow_nan=False)
    assert "values" not in spec["data"] and spec["data"]["name"] in spec["datasets"]


def barred(case="a", solver="pbd", **more):
    """Rows of three runs: with a bound, with an estimate, and with neither."""
    bars = ({"bound_state": 0.012}, {"estimate_state": 0.5}, {})
    return [
        row(case, solver, h, state_sup=h / 9, state_norm=0.0098, **bar, **more)
        for h, bar in zip((0.1, 0.05, 0.02), bars, strict=True)
    ]


def test_an_error_bar_stands_beside_the_error_of_its_run():
    rows = barred()
    rows[1]["state_norm"] = np.nan
    (runs,) = data.read(rows).runs.values()
    assert bar_texts.describe_bars(runs, "state_sup") == [
        "error bar (bound) 0.012, error 9.8e-3",
        "error bar (estimate) 0.5, error not known",
        "",
    ]
    assert bar_texts.describe_bars(runs, "impulse") == ["", "", ""]


def test_tooltips_name_the_error_bars_where_there_are_some():
    tips = lambda spec: [t for layer in spec["layer"] for t in layer["encoding"].get("tooltip", ())]
    spec = studies.error_against_step(barred())
    assert [p["bar"][:15] for p in points(spec)] == ["error bar (boun", "error bar (esti", "none"]
    assert layouts.BAR_TIP in tips(spec)
    for other in (
        studies.error_against_step(barred(feasibility=0.1), metric="violation"),
        studies.error_against_step([{**r, "bound_state": None} for r in barred()[::2]]),
    ):
        assert tips(other) and layouts.BAR_TIP not in tips(other)
    (level,) = points(studies.error_against_step(barred(accuracy="tol")))
    assert level["kind"] == "level" and level["bar"] == "none"
