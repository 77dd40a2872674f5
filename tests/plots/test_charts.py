"""Charts of runs and studies hold the numbers of the rows, show themselves and are written."""

import json

import numpy as np
import pytest

import nsbench
from nsbench.study import Study

STEPS = 0.05 / np.array([1, 2, 3, 5, 8])


@pytest.fixture(scope="module")
def study():
    rows = nsbench.run("tide", ["pbd", "event_driven"], h=STEPS, tol=[1e-8]).rows
    return Study([row | {"seconds": 0.5, "seconds_low": 0.4} for row in rows])


def points(chart, kind="error"):
    return [p for p in chart.spec["datasets"]["points"] if p.get("kind", kind) == kind]


def test_error_chart_holds_the_errors_of_the_rows(study):
    drawn = {(p["h"], p["y"]) for p in points(study.plot.error("tide")) if p["method"] == "pbd"}
    assert drawn == {(r["h"], r["state_sup"]) for r in study.rows if r["solver"] == "pbd"}
    violations = points(study.plot.error("tide", "feasibility"))
    assert all(p["y"] > 0 for p in violations)


def test_a_method_with_a_tolerance_is_a_level_over_steps_and_a_point_over_costs(study):
    assert [p["method"] for p in points(study.plot.error(), "level")] == ["event_driven"]
    costs = study.plot.work_precision(cost="drift_calls")
    assert "event_driven" in {p["method"] for p in points(costs)} and not points(costs, "level")
    seconds = {p["x"] for p in points(study.plot.work_precision())}
    assert seconds == {0.5}


def test_orders_have_intervals(study):
    (found,) = [p for p in points(study.plot.orders()) if p["method"] == "pbd"]
    assert found["case"] == "tide" and found["low"] < found["x"] < found["high"]
    assert found["x"] == pytest.approx(1.0, abs=0.05)


def test_a_trajectory_is_drawn_over_time():
    traj = nsbench.solve("tide", "pbd", h=0.01)
    drawn = points(traj.plot())
    assert [p["y"] for p in drawn] == traj.x[:, 0].tolist()
    assert {p["series"] for p in points(traj.plot("impulse"))} == {"contact (0, 0)"}
    many = nsbench.solve("discs[n=10]", "pbd", h=0.05)
    assert len({p["series"] for p in points(many.plot())}) == 12


def test_what_cannot_be_drawn_is_refused_with_a_sentence(study):
    refused = nsbench.solve("sliding", "pbd", h=0.1)
    with pytest.raises(ValueError, match=r"nothing to draw.*PBD needs constraints"):
        refused.plot()
    with pytest.raises(ValueError, match="one of x, impulse, reaction"):
        nsbench.solve("tide", "pbd", h=0.1).plot("lam")
    with pytest.raises(LookupError, match="no case 'apple' in this study; it has tide"):
        study.plot.error("apple")
    with pytest.raises(LookupError, match="one of seconds, drift_calls, inner"):
        study.plot.work_precision(cost="money")


def test_notebooks_get_the_specification_and_a_picture(study):
    bundle = study.plot.error()._repr_mimebundle_()
    spec = bundle["application/vnd.vegalite.v5+json"]
    assert spec["$schema"].endswith("v5.json") and json.loads(json.dumps(spec, allow_nan=False))
    assert bundle["image/svg+xml"].startswith("<svg") and "Chart(" in bundle["text/plain"]


@pytest.mark.parametrize("ending, start", [("svg", b"<svg"), ("pdf", b"%PDF"), ("json", b"{")])
def test_charts_are_written(study, ending, start, tmp_path):
    path = study.plot.error().save(tmp_path / f"chart.{ending}")
    assert path.read_bytes().startswith(start)


def test_another_ending_is_refused(study, tmp_path):
    with pytest.raises(ValueError, match=r"\.svg, \.pdf, \.json"):
        study.plot.error().save(tmp_path / "chart.png")
