"""Charts of runs and studies hold the numbers of the rows, show themselves and are written."""

import json

import numpy as np
import pytest

import nsbench
from nsbench.report.charts import studies
from nsbench.results import tables

STEPS = 0.05 / np.array([1, 2, 3, 5, 8])


@pytest.fixture(scope="module")
def study():
    return nsbench.run("tide", ["pbd", "event_driven"], h=STEPS, tol=[1e-8])


def points(chart):
    return chart.spec["datasets"]["points"]


def test_charts_of_a_study_are_those_of_its_rows(study):
    found = points(study.plot.error("tide"))
    drawn = {(p["h"], p["y"]) for p in found if p.get("method") == "pbd"}
    assert drawn == {(r["h"], r["state_sup"]) for r in study.rows if r["solver"] == "pbd"}
    assert study.plot.error(metric="force").spec == studies.error_against_step(
        study, None, "force"
    )
    drawn = points(study.plot.work_precision())
    seconds = {p["x"] for p in drawn if "floor" not in p["kind"]}
    assert seconds == {r["seconds"] for r in study.rows}


def colours(chart):
    """Colours of the methods of a chart, from the scale of its points."""
    layer = next(v for v in chart.spec["layer"] if "shape" in v["encoding"])
    scale = layer["encoding"]["color"]["scale"]
    return dict(zip(scale["domain"], scale["range"], strict=True))


def test_one_method_keeps_its_colour_over_those_of_a_folder_of_results(study, tmp_path):
    plain = colours(study.plot.error())
    archive = tmp_path / "0.1.0"
    archive.mkdir()
    released = nsbench.run(["tide", "apple"], ["catching_up", "pbd"], h=STEPS[:2])
    tables.write_tables(archive, released.rows)
    chart = study.plot.error(highlight="pbd", beside=archive)
    drawn = colours(chart)
    assert drawn == {"pbd": plain["pbd"], "catching_up": "#c9c9c9", "event_driven": "#c9c9c9"}
    assert points(chart)[-1]["method"] == "pbd"
    runs = [p for p in points(chart) if p.get("method") == "pbd"]
    assert len(runs) == len(STEPS)  # those of the study, not of the archive
    with pytest.raises(ValueError, match="'euler' has no run of tide"):
        study.plot.error(highlight="euler")


def test_orders_have_intervals(study):
    (found,) = [p for p in points(study.plot.orders()) if p["method"] == "pbd"]
    assert found["case"] == "tide" and found["low"] < found["x"] < found["high"]
    assert found["x"] == pytest.approx(1.0, abs=0.05)


def test_a_trajectory_is_drawn_over_time():
    traj = nsbench.solve("tide", "pbd", h=0.01)
    assert [p["y"] for p in points(traj.plot())] == traj.x[:, 0].tolist()
    assert [p["y"] for p in points(traj.plot("impulse"))] == traj.impulse[:, 0].tolist()


def test_what_cannot_be_drawn_is_refused_with_a_sentence(study):
    with pytest.raises(ValueError, match=r"nothing to draw.*PBD needs constraints"):
        nsbench.solve("sliding", "pbd", h=0.1).plot()
    with pytest.raises(ValueError, match="state or impulse"):
        nsbench.solve("tide", "pbd", h=0.1).plot("lam")
    with pytest.raises(ValueError, match="The study has tide"):
        study.plot.error("apple")
    with pytest.raises(ValueError, match="nothing to draw: no run has a number"):
        nsbench.run("tide", "pbd", h=[0.1]).plot.orders()


def test_a_case_without_a_reference_gets_one_in_the_folder_named(tmp_path):
    case = nsbench.get_case("tide").replace(name="own", exact=None)
    study = nsbench.run(case, "pbd", h=[0.1, 0.05])
    with pytest.raises(ValueError, match=r"own has no reference.*references=FOLDER"):
        study.plot.error()
    study = nsbench.run(case, "pbd", h=[0.1, 0.05], references=tmp_path)
    assert len(points(study.plot.error())) > 1 and list(tmp_path.iterdir())


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
