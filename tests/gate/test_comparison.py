"""`nsbench compare` as a page and as Markdown: what changed against its interval, the history."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from report_rows import row

from nsbench.cli import main
from nsbench.gate import comparison_page
from nsbench.gate.comparison_page import _evidence, _scatters, comparison_section
from nsbench.gate.compared_numbers import common_seconds, read_versions
from nsbench.report.style import format_factor
from nsbench.results import tables
from nsbench.results.journal import SCHEMA


def results(folder, factor=1.0, order=1.0, seconds=1.0, solvers=("pbd", "theta")):
    """Results on disk: errors factor * h^order, seconds that grow as 1 / h."""
    h = 0.1 / np.unique(np.round(4 * 2 ** np.arange(0, 6.4, 0.35)))
    wobble = 1.0 + 0.01 * np.cos(np.arange(len(h)))
    rows = [
        row(
            "tide",
            s,
            float(v),
            state_sup=float(factor * w * v**order),
            impulse=float(2 * v),
            seconds=float(seconds / v),
        )
        for s in solvers
        for v, w in zip(h, wobble, strict=True)
    ]
    folder.mkdir(parents=True)
    tables.write_tables(folder, rows)
    return str(folder)


@pytest.fixture
def versions(tmp_path):
    return [
        results(tmp_path / "1.0", factor=2.0),
        results(tmp_path / "1.1", factor=3.0, seconds=0.5),
        results(tmp_path / "1.2", factor=3.0, order=1.3, seconds=0.25),
    ]


def changes(section):
    return {
        tuple(c.text for c in row.cells[1:4]): [c.text for c in row.cells[4:]]
        for _, table in section.tables[:1]
        for row in table.rows
    }


def section_of(folders, rtol=1e-6):
    from nsbench.cli.compare import _compare

    read = read_versions(folders)
    return comparison_section(read, _compare(*read[-2:], rtol))


def test_a_change_is_shown_with_both_numbers_and_its_per_cent(versions):
    table = changes(section_of(versions[:2]))
    before, after, change, interval = table["pbd", "ladder", "state constant"]
    assert float(after) / float(before) == pytest.approx(1.5, rel=1e-2)
    assert [len(number.replace(".", "")) for number in (before, after)] == [4, 4]
    assert change == "+50 %" and interval == "–"


def test_an_order_is_told_against_the_interval_of_before(versions):
    section = section_of(versions[1:])
    before, after, _, interval = changes(section)["pbd", "ladder", "state order"]
    assert (before, after) == ("1.000", "1.300") or abs(float(after) - 1.3) < 0.01
    assert interval.startswith("± ") and interval.endswith("outside")
    assert "2 of 2 orders that changed lie outside" in section.evidence[0]


def test_seconds_are_of_the_same_accuracy(versions, tmp_path):
    read = read_versions(versions)
    for values in common_seconds(read).values():
        assert values[0] / values[1] == pytest.approx(2.0)
        assert values[1] / values[2] == pytest.approx(2.0)
        steps = sorted(read[0].asked["tide", "pbd"])
        assert values[0] == read[0].asked["tide", "pbd"][steps[len(steps) // 2]]
    said = section_of(versions[:2]).evidence[1]
    assert "2 runs" in said and said.endswith("median 0.5, quartiles 0.5 and 0.5.")
    other = results(tmp_path / "other", solvers=("theta",))
    assert list(common_seconds(read_versions([versions[0], other]))) == [("tide", "theta")]


def test_the_history_is_relative_to_the_first_version(versions, tmp_path):
    tables_ = dict(section_of(versions).tables)
    seconds = tables_["History: seconds, over the first version"]
    assert seconds.columns == ("method", "1.0", "1.1", "1.2")
    assert [c.text for c in seconds.rows[0].cells] == ["pbd", "1", "0.5", "0.25"]
    constants = tables_["History: constant of the state error, over the first version"]
    assert [c.text for c in constants.rows[0].cells[:3]] == ["pbd", "1", "1.5"]
    short = [results(tmp_path / f"short{k}", seconds=1e-4) for k in range(3)]
    assert dict(section_of(short).tables)["History: seconds, over the first version"].rows


def test_changes_lie_case_by_case_and_the_scatter_has_its_line_of_equals(tmp_path):
    """Two cases whose methods come in another order than their names."""
    folders = []
    for name, factor in (("1.0", 1.0), ("1.1", 2.0)):
        h = 0.1 / np.unique(np.round(4 * 2 ** np.arange(0, 6.4, 0.35)))
        rows = [
            row(case, s, float(v), state_sup=float(factor * v), impulse=float(v), seconds=1.0)
            for case, s in (("wedge", "pbd"), ("box", "theta"), ("wedge", "catching_up"))
            for v in h
        ]
        (tmp_path / name).mkdir()
        tables.write_tables(tmp_path / name, rows)
        folders.append(str(tmp_path / name))
    section = section_of(folders)
    cases = [r.group for _, table in section.tables[:1] for r in table.rows]
    assert cases == sorted(cases) and set(cases) == {"box", "wedge"}
    numbers = section.figures[0].svg
    (line,) = re.findall(r'mark-line.*?<path[^>]* d="([^"]*)"', numbers)
    x, y, to_x, to_y = map(float, re.fullmatch(r"M(.+),(.+)L(.+),(.+)", line).groups())
    assert to_x > x and to_y < y


def test_numbers_that_have_become_zero_or_infinite_lie_on_no_logarithmic_axis(versions, tmp_path):
    for name, factor in (("zero", 0.0), ("far", np.inf)):
        other = results(tmp_path / name, factor=factor, seconds=1e-4)
        for pair in ([versions[0], other], [other, versions[0]]):
            section = section_of(pair)
            assert section.tables[0][1].rows
            assert [f.file for f in section.figures] == ["numbers.svg", "seconds.svg"]
            assert "Seconds after over before, 2 runs" in section.evidence[-1]


def test_nothing_is_said_to_change_where_nothing_did(versions):
    section = section_of([versions[0], versions[0]])
    assert section.answer.startswith("Nothing changed") and not changes(section)
    assert section.evidence[0] == "No order changed."


@pytest.mark.parametrize("key", ["machine", "cpu"])
@pytest.mark.parametrize("other, differ", [("B", True), ("A", False)])
def test_seconds_of_two_machines_are_said_not_to_be_comparable(versions, key, other, differ):
    for folder, name in zip(versions, ("A", other), strict=False):
        env = {"schema": SCHEMA, key: name}
        (Path(folder) / "env.json").write_text(json.dumps(env), encoding="utf-8")
    sentence = "The two were computed on different machines: their seconds cannot be compared."
    assert (sentence in section_of(versions[:2]).evidence) == differ


def test_the_command_writes_a_page_and_markdown(versions, tmp_path, capsys):
    page, summary = tmp_path / "c.html", tmp_path / "c.md"
    args = ["compare", *versions, "--html", str(page), "--summary", str(summary)]
    assert main(args) == 0
    text = page.read_text(encoding="utf-8")
    assert "What changed from 1.1 to 1.2?" in text and text.count("<img") == 4
    assert "default-src" in text
    assert {s[:5] for s in re.findall(r'<img [^>]*src="([^"]*)"', text)} == {"data:"}
    assert "| state order |" in summary.read_text()
    assert summary.read_text().startswith("### 1.2 against 1.1\n")
    again = tmp_path / "again.html"
    assert main(["compare", *versions, "--html", str(again)]) == 0
    assert again.read_bytes() == page.read_bytes()
    capsys.readouterr()
    assert main(["compare", *versions]) == 2
    assert "--html" in capsys.readouterr().err


def test_quartiles_are_of_the_ratios_of_all_runs(versions):
    old, new = read_versions(versions[:2])
    seconds = {("case", str(k)): [2.0, 2.0 * 1.1**k] for k in range(200)}
    assert "200 runs" in (said := list(_evidence(old, new, [], seconds))[1])
    low, middle, high = (format_factor(1.1**k) for k in (49, 99, 149))
    assert said.endswith(f"median {middle}, quartiles {low} and {high}.")


def test_points_of_the_scatter_lie_at_the_seconds_before_and_after(versions, monkeypatch):
    points = []
    nowhere = {"x": 0.0}  # is not drawn
    monkeypatch.setattr(comparison_page, "_point", lambda *p: points.append(p) or nowhere)
    old, new = read_versions(versions[1:])
    _scatters(old, new, {("tide", "pbd"): [3.0, 0.5, 0.25]})
    assert points[-1] == ("tide, pbd", "seconds", 0.5, 0.25)
