"""What the report says of how to repeat and cite a study can be run, and read by any page."""

import pandas
import pytest
from report_rows import row

from nsbench import write_report
from nsbench.report.tables.environment_tables import (
    citation,
    describe_load,
    environment_table,
    repeat_lines,
)


def test_the_lines_that_repeat_a_figure_run(tmp_path, monkeypatch):
    """Commands and lines as the page prints them, on rows that a study has written."""
    env = {"argv": ["run", "tide", "-o", "my rows"], "folder": "my rows"}
    lines = repeat_lines(env | {"versions": {"nsbench": "0.1.0"}})
    assert "nsbench run tide -o 'my rows'\n" in lines and "nsbench report 'my rows' " in lines
    assert "results" not in lines and "nsbench run CASE -s METHOD -o again " in lines
    assert "--h STEP" in lines
    (tmp_path / "my rows").mkdir()
    rows = [row("tide", "pbd", h, state_sup=h, seconds=1e-3 / h) for h in (0.1, 0.05)]
    pandas.DataFrame(rows).to_parquet(tmp_path / "my rows" / "runs.parquet")
    monkeypatch.chdir(tmp_path)
    exec(lines[lines.index("import matplotlib") :], {})
    assert (tmp_path / "work_precision.pdf").stat().st_size > 1000


def test_names_that_no_page_can_hold_are_written_by_their_numbers():
    lines = repeat_lines({"argv": ["run", "--cases", "B\udcfccher\x1b[0m.py"]})
    assert lines.encode() and "\x1b" not in lines and "cher" in lines


@pytest.mark.parametrize("folder", [5, None, "", ["a"]])
def test_a_folder_that_is_no_text_stops_no_report(folder):
    assert "nsbench report results " in repeat_lines({"folder": folder})


@pytest.mark.parametrize("argv", [5, "run", None, [], {"a": 1}])
def test_an_environment_that_holds_no_command_stops_no_report(argv):
    assert "nsbench run\n" in repeat_lines({"argv": argv, "versions": 3})


def test_a_study_without_an_environment_can_be_cited():
    assert "version = {VERSION}" in citation({}) and "2310.01215" in citation({})


def test_the_report_has_an_entry_of_its_own():
    env = {"written": "2026-11-29T19:37:08+00:00", "versions": {"nsbench": "0.1.0"}, "package": "ab"}
    entry = citation(env, ["pbd", "euler"], 3).split("\n}\n")[0]
    assert entry.startswith("@misc{nsbench-report,") and "year    = {2026}" in entry
    assert "nsbench 0.1.0 on 3 cases with 2 methods" in entry and "2026-11-29, package ab" in entry
    assert "nsbench-report" not in citation(env, ["pbd"])


@pytest.mark.parametrize("versions", [{"nsbench": "0.2.0.dev123+g0123456789abcdef"}, {}, None, 3])
def test_the_head_of_the_page_names_the_version_that_is_cited(tmp_path, versions):
    class Study:
        rows = [row("tide", "pbd", 0.1, state_sup=0.1)]
        env = {"versions": versions}

    page = write_report(Study, tmp_path / "r.html").read_text(encoding="utf-8")
    lede = page.split('<p class="lede">')[1].split("</p>")[0]
    known = versions == {"nsbench": "0.2.0.dev123+g0123456789abcdef"}
    assert ("nsbench 0.2.0.dev123+g0123456789abcdef" in lede) == known
    assert ("nsbench" in lede) == known and "VERSION" not in lede
    assert ("version = {0.2.0.dev123+g0123456789abcdef}" in page) == known


@pytest.mark.parametrize(
    "env, said",
    [
        ({}, "was not recorded"),
        ({"load": [0.5, 0.1, 0.0]}, "Load average over a minute: 0.5, "),
        ({"load": [1.5], "load_at_start": [0.25], "cores": 2}, "0.25 at the start and 1.5 at the"),
        ({"load": [1.5], "load_at_start": [2.5], "cores": 2}, "more than the 2 cores"),
        ({"load": "busy", "cores": [3]}, "was not recorded"),
        ({"load": [True]}, "was not recorded"),
    ],
)
def test_the_load_while_runs_were_timed_is_told(env, said):
    assert said in describe_load(env)
    assert ("too large" in describe_load(env)) == ("more than" in said)


def test_the_machine_is_described_in_words():
    found = environment_table({"processor": "A fast one", "load_at_start": [0.5, 0.4, 0.3]})
    words = {row.cells[0].text: row.cells[1].text for row in found.rows}
    assert words["load average over 1, 5, 15 minutes as runs began"] == "0.5 0.4 0.3"
    assert words["processor"] == "A fast one" and "was not recorded" in found.note
