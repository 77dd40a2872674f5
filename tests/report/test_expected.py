"""What methods declare to expect is compared with what is seen; deviations in either direction are
told."""

import numpy as np
import pytest
from report_rows import STEPS, row

import nsbench
from nsbench import solvers
from nsbench.report import data as source
from nsbench.report import expectations, summary, verdict
from nsbench.report.assemble import assemble_content, draw_figures
from nsbench.report.html_page import render_page
from nsbench.report.markdown import render_markdown
from nsbench.report.tables import multiplier_tables, reliability_tables

SOLVERS = {
    "pbd": {
        "accuracy": "h",
        "claims": {"state": 1.0, "impulse": 1.0},
        "expects": [
            {"when": ["exact_at_grid"], "state": "exact", "impulse": "exact", "why": "constant"},
            {"when": ["zeno"], "state": "chatter", "impulse": None, "why": "Zeno"},
            {"when": ["filippov"], "state": "refused", "impulse": None, "why": "no constraint"},
            {"when": ["constant_force"], "state": "open", "impulse": "open", "why": "no expansion"},
        ],
    }
}


def study(error, classes=(), **more):
    """One case, one method, state error `error(h)`, impulse of order 1."""
    rows = [
        row("a", "pbd", float(h), state_sup=float(error(h)), impulse=float(h), **more)
        for h in STEPS
    ]
    data = source.build(
        source.columns_of(rows), {"a": {"classes": list(classes), "T": 1.0}}, SOLVERS
    )
    return data, summary.summarise(data)


def found(error, classes=(), known=None, **more):
    data, s = study(error, classes, **more)
    return {
        f.metric: f
        for f in expectations.judge_expectations(data, s, {} if known is None else known)
    }


@pytest.mark.parametrize(
    "error, classes, outcome",
    [
        (lambda h: h, (), "kept"),
        (lambda h: h**2, (), "above"),
        (lambda h: h**0.5, (), "below"),
        (lambda h: 1 / h, (), "diverges"),
        (lambda h: 1e-17, (), "exact"),
        (lambda h: 0.5 + h, (), "plateau"),
        (lambda h: 1e-17, ("exact_at_grid",), "kept"),
        (lambda h: h, ("exact_at_grid",), "below"),
        (lambda h: h, ("zeno",), "passes"),
    ],
)
def test_a_deviation_is_named_in_either_direction(error, classes, outcome):
    assert found(error, classes)["state"].outcome == outcome


def test_a_failure_that_is_expected_is_kept_and_one_that_passes_is_told():
    failing = dict(status="chatter", why="Events accumulate.")
    assert found(lambda h: h, ("zeno",), **failing)["state"].outcome == "kept"
    assert found(lambda h: h, (), **failing)["state"].outcome == "chatter"
    refused = dict(status="refused", why="PBD needs constraints.")
    assert found(lambda h: h, ("filippov",), **refused)["state"].outcome == "kept"
    assert found(lambda h: h, (), **refused) == {}


def test_known_deviations_are_told_apart_from_new_ones_and_from_those_gone():
    known = {("a", "pbd", "state"): ("above", "a symmetric layer")}
    same = list(found(lambda h: h**2, known=known).values())
    assert (
        same[0].known
        and not expectations.new_deviations(same, known)
        and not expectations.resolved_deviations(same, known)
    )
    passes = list(found(lambda h: h, known=known).values())
    assert (
        not passes[0].known
        and len(expectations.resolved_deviations(passes, known)) == 1
        and not expectations.new_deviations(passes, known)
    )
    words = [r.cells[0].text for r in reliability_tables.expected_table(passes, known).rows]
    assert words == ["no longer seen"]
    assert [r.cells[0].text for r in reliability_tables.expected_table(same, known).rows] == [
        "known"
    ]


def test_new_deviations_open_the_report():
    data, s = study(lambda h: h**2)
    said = [x for x in verdict.write_verdict(data, s) if x.head == "Not as expected"]
    assert len(said) == 1 and "order 1 was expected" in said[0].sentences[0]
    c = assemble_content(data, draw_figures(data))
    assert "Expected against observed" in render_page(c)
    assert "Expected against observed" in render_markdown(c)


def test_the_table_in_the_repository_is_complete_and_names_what_exists():
    for (case, solver, _), (observed, why) in expectations.read_deviations().items():
        nsbench.get_case(case), solvers.get(solver)
        assert observed and len(why) > 20


def test_a_broken_table_is_refused(tmp_path):
    head = "case,solver,metric,observed,why\n"
    for bad in (
        "a,pbd,state,above,\n",
        "a,pbd,nothing,above,because\n",
        "a,pbd,state,above,x\n" * 2,
    ):
        (tmp_path / "t.csv").write_text(head + bad)
        with pytest.raises(ValueError, match=r"t\.csv, line"):
            expectations.read_deviations(tmp_path / "t.csv")


def test_selection_shows_the_false_plateau_of_a_naive_comparison():
    rng = np.random.default_rng(2)
    rows = [
        row(
            "a",
            "pbd",
            float(h),
            state_sup=float(h),
            reaction=float(h),
            polyhedron=float(h),
            multipliers_unique=False,
            selection=float((0.5 + h) * np.exp(0.01 * rng.standard_normal())),
        )
        for h in STEPS
    ]
    data = source.build(source.columns_of(rows), {"a": {"T": 1.0}}, SOLVERS)
    table = multiplier_tables.selection_table(data, summary.summarise(data))
    cells = [c.text for c in table.rows[0].cells]
    assert (
        cells[1].startswith("1.00")
        and cells[2].startswith("1.00")
        and cells[4].startswith("plateau at 0.5")
    )
    assert "WARNING" in table.note
    assert not multiplier_tables.selection_table(*study(lambda h: h)).rows


def test_errors_below_ten_times_the_bound_are_not_printed():
    rows = [
        row(
            "a",
            "event_driven",
            1e-12,
            "tol",
            state_sup=3e-12,
            impulse=3e-12,
            state_floor=1e-11,
            state_scale=1.0,
        )
    ]
    data = source.build(
        source.columns_of(rows),
        {},
        {"event_driven": {"accuracy": "tol", "claims": {"exact": 1e-9}}},
    )
    assert (
        reliability_tables.bounds_table(data, summary.summarise(data)).rows[0].cells[2].text
        == "< 1e-11"
    )


@pytest.mark.parametrize("classes, flag", [((), "above"), (("constant_force",), "")])
def test_an_order_is_not_off_a_claim_where_none_is_made(classes, flag):
    data, found = study(lambda h: h**2, classes)
    assert found["a", "pbd"].state.flag == flag
    said = " ".join(text for s in verdict.write_verdict(data, found) for text in s.sentences)
    assert ("Above the claim: pbd on a" in said) == bool(flag)
