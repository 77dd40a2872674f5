"""One table of columns: whatever a run writes is described in it, and what it describes is used."""

import dataclasses
from pathlib import Path

import numpy as np
import pyarrow.parquet
import pytest
from report_rows import row

import nsbench
from nsbench import columns, study
from nsbench.cli import main
from nsbench.columns import page, table
from nsbench.gate.facts import facts
from nsbench.measure import residuals
from nsbench.report import assemble, markdown
from nsbench.report.data import Data, build, columns_of, merge, read
from nsbench.results import tables
from nsbench.solvers import get
from nsbench.study.attempt import run_one

ROOT = Path(nsbench.__file__).parents[1]
NEW = columns.Column(
    "state_rms", "error", "number", "state", "root mean square of |x - x*|", "state, mean", "near"
)
METHODS = (
    ("tide", "pbd", 0.01),
    ("tide", "catching_up", 0.01),
    ("tide", "event_driven", 1e-9),
    ("sliding", "euler", 0.01),
    ("sliding", "euler[implicit=true]", 0.01),
    ("diode_bridge", "theta", 1e-4),
)


@pytest.fixture
def set_columns(monkeypatch):
    """Sets the entries of the table for one test; the index of their names is made from them."""

    def entries(columns):
        monkeypatch.setattr(table, "COLUMNS", columns)
        table.by_name.cache_clear()

    yield entries
    monkeypatch.undo()
    table.by_name.cache_clear()


@pytest.fixture
def with_new(set_columns):
    """One entry more in the table, and no other edit."""
    set_columns((*table.COLUMNS, NEW))


def rows_with(**more):
    return [
        row("tide", "pbd", h, state=h, state_sup=h, feasibility=0.1 * h, **more)
        for h in (0.1, 0.05, 0.02)
    ]


def shown(data: Data) -> tuple[str, dict]:
    """The report as Markdown, and its tables by key."""
    content = assemble.assemble_content(data, assemble.draw_figures(data))
    return markdown.render_markdown(content), content.tables


def test_names_are_told_once_and_refer_to_columns_that_exist():
    names = [c.name for c in table.COLUMNS]
    assert len(names) == len(set(names))
    for c in table.COLUMNS:
        assert {c.floor, c.scale} - {""} <= set(names), c.name
        assert c.meaning and not c.meaning.endswith("."), c.name
        assert c.kind != "word" or not (c.unit or c.gate), c.name
        assert c.kind in ("word", "flag") or c.unit, c.name


@pytest.mark.parametrize("field", ["kind", "group", "gate", "owner"])
def test_a_word_that_does_not_exist_is_refused(field):
    good = dict(name="x", group="error", kind="number", unit="1", meaning="y")
    with pytest.raises(ValueError, match=f"column x: {field} is 'nonsense'"):
        columns.Column(**good | {field: "nonsense"})


@pytest.mark.parametrize("case, solver, accuracy", METHODS)
def test_every_column_that_a_run_writes_is_in_the_table(case, solver, accuracy):
    """Those that a method counts are its own; all others are the bench's."""
    spec = study.Spec(case, solver, get(solver).accuracy, accuracy)
    found = run_one(spec)
    assert found["status"] in ("ok", "below_reference"), found["why"]
    known = columns.by_name()
    assert set(found) <= set(known)
    bench = {n for n in found if known[n].owner == "bench"}
    stats = set(nsbench.solve(case, solver, **{get(solver).accuracy: accuracy}).stats)
    assert set(found) - bench <= stats | {"h"} and not stats & bench


def test_a_method_writes_no_column_of_the_bench():
    """Not even one that the bench leaves out for a run that it cannot measure."""
    assert {"case", "seconds", "state_sup", "residual", "check", "below", "read", "unlike"} <= (
        columns.reserved_names()
    )
    assert not {"h", "steps", "loop"} & columns.reserved_names()


def test_a_new_entry_is_everywhere_without_another_edit(with_new, tmp_path, capsys):
    assert main(["list", "metrics"]) == 0
    assert "root mean square of |x - x*|  [state]" in capsys.readouterr().out
    assert "| `state_rms` | number | state |" in page.page()
    rows = rows_with(state_rms=0.25)
    tables.write_tables(tmp_path, rows)
    field = pyarrow.parquet.read_schema(tmp_path / "runs.parquet").field("state_rms")
    assert field.metadata[b"unit"] == b"state" and field.metadata[b"owner"] == b"bench"
    for data in (read(rows), read(tmp_path)):
        assert np.all(data.runs["tide", "pbd"].col["state_rms"] == 0.25)
        text, made = shown(data)
        assert "state, mean (state\\_rms) | root mean square" in text
        assert "state, mean" in made["errors"].columns and "0.25" in text
        assert ("tide", "pbd", "h=0.0505", "state_rms") in facts(data)
    case = nsbench.get_case("tide")
    assert np.isnan(nsbench.errors(case, nsbench.solve(case, "pbd", h=0.1))["state_rms"])
    assert "state_rms" in columns.reserved_names()


def test_what_is_not_an_entry_any_more_is_gone_from_the_errors(set_columns):
    """The mirror of the test above: the errors take their names from the table."""
    fewer = tuple(c for c in table.COLUMNS if c.name != "set_distance")
    set_columns(fewer)
    case = nsbench.get_case("tide")
    assert "set_distance" not in nsbench.errors(case, nsbench.solve(case, "pbd", h=0.1))


def test_a_new_residual_is_an_entry_and_a_computation(set_columns, monkeypatch):
    """The entry alone brings the column, without a value until one is computed."""
    new = dataclasses.replace(NEW, name="energy", group="residual", label="energy balance")
    set_columns((*table.COLUMNS, new))
    case = nsbench.get_case("tide")
    run = nsbench.solve(case, "pbd", h=0.1)
    assert np.isnan(nsbench.errors(case, run)["energy"])
    gaps = residuals._gaps
    computed = lambda *args: (gaps(*args)[0] | {"energy": -0.5}, gaps(*args)[1])
    monkeypatch.setattr(residuals, "_gaps", computed)
    found = nsbench.errors(case, run)
    assert found["energy"] == -0.5 and found["feasibility"] >= 0.0
    _, made = shown(read(rows_with(energy=-0.5)))
    errors = made["errors"]
    cells = dict(zip(errors.columns, (c.text for c in errors.rows[0].cells), strict=True))
    assert cells["energy balance"] == "-0.5" and "violation" in cells


def test_every_error_that_is_measured_reaches_the_report():
    """Also set_distance and sup, and in Markdown as on the page."""
    data = read(rows_with(set_distance=0.125, sup=0.375, below=""))
    text, made = shown(data)
    errors = made["errors"]
    cells = dict(zip(errors.columns, (c.text for c in errors.rows[0].cells), strict=True))
    assert cells["distance to the set of solutions"] == "0.12"
    assert cells["multiplier, any interval"] == "0.38"
    assert "### Every error and residual at the finest step" in text and "| 0.12 |" in text


def test_errors_that_say_nothing_are_shown_as_below():
    data = read(rows_with(sup=1.5e-9, state_floor=1.0, l1=2e-9, below="l1 state_sup"))
    errors = shown(data)[1]["errors"]
    cells = dict(zip(errors.columns, (c.text for c in errors.rows[0].cells), strict=True))
    assert cells["state"] == "< 1" and cells["impulse, L1"] == "below"
    assert cells["multiplier, any interval"] == "1.5e-9"


def test_columns_of_a_method_that_are_not_in_the_table_are_kept(tmp_path):
    rows = rows_with(own_count=7, own_word="fast", own_flag=True)
    tables.write_tables(tmp_path, rows)
    (tmp_path / "csv").mkdir()
    (tmp_path / "csv" / "runs.csv").write_bytes((tmp_path / "runs.csv").read_bytes())
    for data in (read(rows), read(tmp_path), read(tmp_path / "csv")):
        col = data.runs["tide", "pbd"].col
        assert np.all(col["own_count"] == 7.0) and np.all(col["own_flag"] == 1.0)
        assert set(col["own_word"]) == {"fast"}
        text, _ = shown(data)
        assert "own\\_count" in text and "counted by the method" in text
    column = columns.describe("own_count")
    assert (column.unit, column.owner) == ("", "solver")


def test_folders_with_different_columns_stand_on_one_page():
    one = build(columns_of(rows_with(own=1.0, mixed=2.0)))
    other = build(columns_of([row("sliding", "pbd", 0.1, state_sup=0.1, mixed="two")]))
    both = merge([one, other])
    assert np.all(both.runs["tide", "pbd"].col["own"] == 1.0)
    assert np.all(np.isnan(both.runs["sliding", "pbd"].col["own"]))
    assert set(both.runs["sliding", "pbd"].col["mixed"]) == {"two"}
    assert set(both.runs["tide", "pbd"].col["mixed"]) == {"2.0"}


def test_the_page_of_columns_is_current():
    """python -m nsbench.columns.page > docs/columns.md"""
    assert (ROOT / "docs" / "columns.md").read_text(encoding="utf-8") == page.page()


@pytest.mark.parametrize(
    "case, solver, asked, norm",
    (
        ("tide", "event_driven", ("tol", 1e-10), "length"),
        ("crossing", "event_driven", ("tol", 1e-10), "coordinate"),
        ("tide", "pbd", ("h", 0.1), None),
    ),
)
def test_a_row_says_in_which_norm_an_error_is_claimed(case, solver, asked, norm):
    from nsbench.study.attempt import attempt
    from nsbench.study.plan import Spec

    row, _ = attempt(Spec(case, solver, *asked))
    assert row.get("claim_norm") == norm
