"""Rows of a study reach pandas, xarray and LaTeX as they are; objects are short in notebooks."""

import importlib.util

import numpy as np
import pytest

import nsbench
from nsbench.study import Study

STEPS = [0.05, 0.03, 0.01]


@pytest.fixture(scope="module")
def study():
    return nsbench.run("tide", ["pbd", "catching_up"], h=STEPS)


def test_pandas_holds_the_rows(study):
    frame = study.to_pandas()
    assert frame["state_sup"].tolist() == [row["state_sup"] for row in study.rows]
    assert frame.equals(study.frame())


def test_xarray_holds_every_number_at_its_place_with_its_unit(study):
    pytest.importorskip("xarray", reason="xarray is optional: pip install 'nsbench[xarray]'")
    data = study.to_xarray()
    for row in study.rows:
        at = {name: row[name] for name in ("case", "solver", "asked")}
        assert float(data["state_sup"].sel(at)) == row["state_sup"]
        assert data["status"].sel(at).item() == row["status"]
    assert data["state_sup"].attrs["units"] == "state"
    assert list(data["asked"]) == sorted(STEPS)


def test_runs_that_are_not_there_are_nan(study):
    pytest.importorskip("xarray", reason="xarray is optional: pip install 'nsbench[xarray]'")
    data = Study(study.rows[:-1]).to_xarray()
    assert np.isnan(data["state_sup"]).sum() == 1
    with pytest.raises(ValueError, match="two rows have the same case, solver and accuracy"):
        Study([*study.rows, study.rows[0]]).to_xarray()


def test_without_xarray_a_sentence_says_what_to_install(study, monkeypatch):
    find = importlib.util.find_spec
    missing = lambda name, *more: None if name == "xarray" else find(name, *more)
    monkeypatch.setattr("nsbench.study.export.find_spec", missing)
    with pytest.raises(ImportError, match=r"pip install 'nsbench\[xarray\]'"):
        study.to_xarray()


def test_latex_escapes_words_and_writes_powers():
    rows = [
        {"case": "a_b", "solver": "x%", "asked": 1e-7, "state_sup": 0.12345, "why": None},
        {"case": "c", "solver": "y", "asked": 0.1, "state_sup": float("nan"), "why": "50 & 60"},
    ]
    text = Study(rows).to_latex(["state_sup", "why"])
    assert r"a\_b & x\% & $1 \cdot 10^{-7}$ & 0.123 & -- \\" in text
    assert r"c & y & 0.1 & -- & 50 \& 60 \\" in text
    with pytest.raises(LookupError, match="no column 'sup'"):
        Study(rows).to_latex(["sup"])


def test_latex_gives_no_error_below_its_floor_as_a_number():
    row = {"case": "a", "solver": "s", "asked": 0.1, "state_floor": 2.5e-13, "l1": 2e-14}
    text = Study([row | {"state_sup": 1e-15}, row | {"state_sup": 3e-13}]).to_latex(["state_sup"])
    assert r"a & s & 0.1 & $< 2.5 \cdot 10^{-13}$ \\" in text
    assert r"a & s & 0.1 & $3 \cdot 10^{-13}$ \\" in text


def test_objects_are_short_in_notebooks(study):
    case = nsbench.get_case("tide")
    traj = nsbench.solve(case, "pbd", h=0.01)
    fit = nsbench.fit_order([0.1, 0.05, 0.02], [0.1, 0.05, 0.02])
    for thing in (case, traj, study, fit, study.plot):
        assert len(repr(thing)) < 160 and "\n" not in repr(thing)
    for thing in (case, traj, study, fit):
        table = thing._repr_html_()
        assert table.startswith("<table>") and table.count("<tr>") == table.count("</tr>") > 2


def test_html_is_escaped():
    rows = [{"case": "<b>", "solver": "pbd", "asked": 1.0, "status": "ok", "state_sup": 1.0}]
    assert "&lt;b&gt;" in Study(rows)._repr_html_() and "<b>&" not in Study(rows)._repr_html_()


def test_a_study_says_whose_errors_are_not_known():
    assert "not known" not in repr(nsbench.run("tide", "pbd", h=0.05))
    own = nsbench.get_case("tide").replace(exact=None, exact_impulse=None, name="own")
    assert repr(nsbench.run(own, "pbd", h=0.05)).endswith(
        "1 ok; errors of 1 case not known: no reference)"
    )
