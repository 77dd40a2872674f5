"""Every way in which a number can differ from the baseline is told, and nothing that is not a
number passes."""

from dataclasses import replace

import numpy as np
import pytest
from report_rows import row

from nsbench.cli import main
from nsbench.gate import baseline, spreads, update
from nsbench.gate.baseline import Line
from nsbench.gate.comparison import (
    MAX_FINDINGS_LISTED,
    OUTCOMES,
    compare,
    count_outcomes,
    describe_changed_cases,
    exit_code,
    format_lines,
    format_summary,
)
from nsbench.gate.facts import Fact, facts
from nsbench.report.data import read
from nsbench.results import tables

FACT = Fact("tide", "pbd", "h=0.01", "state_sup", "near", 0.25, "", "case=aa reference=bb")
COUNT = Fact("tide", "pbd", "h=0.01", "steps", "count", 300.0, "", "case=aa reference=bb")
INF = float("inf")
WORD = Fact("tide", "pbd", "ladder", "statuses", "class", "19 ok", "", "case=aa reference=bb")


def book(*facts, spread=0.0):
    return {f.key: baseline.line(f, spread, "first") for f in facts}


def outcome(fact, line):
    return compare({fact.key: fact}, {line.key: line})[0].outcome


@pytest.mark.survives("another baseline")
@pytest.mark.parametrize(
    "value, expected",
    [
        (0.25, "pass"),
        (0.25 * (1 + 9e-7), "pass"),
        (0.25 * (1 + 2e-6), "regressed"),
        (0.24, "improved"),
        (float("nan"), "regressed"),
        (float("inf"), "regressed"),
        (-0.25, "improved"),
    ],
)
def test_a_number_is_held_on_both_sides_and_nan_never_passes(value, expected):
    assert outcome(replace(FACT, value=value), baseline.line(FACT, 0.0, "first")) == expected


def test_orders_have_no_better_side():
    fact = replace(FACT, metric="state order", value=1.0)
    assert outcome(replace(fact, value=0.5), baseline.line(fact, 0.0, "first")) == "regressed"


@pytest.mark.parametrize(
    "kind, low, high", [("max", "pass", "regressed"), ("min", "regressed", "pass")]
)
def test_one_sided_kinds(kind, low, high):
    line = Line(*FACT.key, kind, 1.0, 0.0, 0.1, "", FACT.config, "")
    assert (
        outcome(replace(FACT, value=0.5), line) == low
        and outcome(replace(FACT, value=1.5), line) == high
    )
    assert outcome(replace(FACT, value=float("nan")), line) == "regressed"


def test_counts_are_exact_unless_they_were_seen_to_move():
    exact = baseline.line(COUNT, 0.0, "")
    loose = baseline.line(COUNT, 1.0, "")
    assert [outcome(replace(COUNT, value=v), exact) for v in (300.0, 301.0, 299.0)] == [
        "pass",
        "regressed",
        "improved",
    ]
    assert outcome(replace(COUNT, value=301.0), loose) == "pass"


def test_words_and_statuses():
    line = baseline.line(WORD, 0.0, "")
    assert (
        outcome(WORD, line) == "pass"
        and outcome(replace(WORD, value="19 refused"), line) == "status changed"
    )
    assert outcome(replace(FACT, value="many"), baseline.line(FACT, 0.0, "")) == "regressed"


@pytest.mark.survives("another baseline")
def test_another_configuration_is_named_and_not_compared():
    found = compare({FACT.key: replace(FACT, config="case=aa reference=cc")}, book(FACT))
    assert (
        found[0].outcome == "configuration differs"
        and "reference" in found[0].sentence
        and exit_code(found) == 4
    )


def test_an_edited_case_is_one_finding_with_the_count_of_its_numbers():
    facts = [replace(FACT, parameters=f"h={h}") for h in range(45)]
    facts.append(replace(FACT, case="hex"))
    edited = {f.key: replace(f, config="case=cc reference=bb") for f in facts}
    found = compare(edited, book(*facts))
    lines = format_lines(found)
    assert len(lines) == 3 and lines[2] == "46 numbers: 46 configuration differs"
    assert lines[0].startswith("configuration differs: tide pbd h=0 ")
    assert lines[0].endswith("not comparable; nor are 44 more numbers of tide")
    assert lines[1].endswith("not comparable") and "hex pbd" in lines[1]
    table = [k for k in format_summary(found, 4).splitlines() if k.startswith("| configuration")]
    assert len(table) == 2 and "nor are 44 more numbers of tide" in table[0]


@pytest.mark.survives("another baseline")
def test_what_one_side_lacks_is_not_fine():
    missing = compare({}, book(FACT))
    new = compare({FACT.key: FACT}, {})
    assert (missing[0].outcome, new[0].outcome) == ("missing", "new")
    assert exit_code(missing) == exit_code(new) == exit_code([]) == 4
    both = compare(
        {FACT.key: FACT, WORD.key: replace(WORD, value="19 failed")}, book(FACT, COUNT, WORD)
    )
    assert exit_code(both) == 1 and {f.outcome for f in both} == {
        "pass",
        "missing",
        "status changed",
    }


def test_a_number_is_missing_of_a_run_or_with_the_run():
    """At another step the method was run on the case."""
    for other, said in (
        (replace(FACT, parameters="h=7"), "does not give it any more"),
        (replace(FACT, solver="other"), "was not run on this case"),
    ):
        missing = [f for f in compare({other.key: other}, book(FACT)) if f.outcome == "missing"]
        assert len(missing) == 1 and said in missing[0].sentence


def test_a_changed_case_is_named_as_the_cause_of_what_is_missing_or_new(tmp_path, capsys):
    """The table of an edited case may have other rows: then no line's configuration differs."""
    other = replace(FACT, parameters="h=7", config="case=cc reference=bb")
    causes = describe_changed_cases({other.key: other}, book(FACT))
    assert len(causes) == 1 and causes[0].startswith("case tide has changed")
    assert "(digest aa -> cc)" in causes[0]
    differences = compare({other.key: other}, book(FACT))
    assert "this run, case of another version, does not" in differences[0].sentence
    assert "digest aa -" in format_summary(differences, 4, causes)
    for same in (replace(other, config=FACT.config), replace(other, case="hex")):
        assert describe_changed_cases({same.key: same}, book(FACT)) == []
    base = tmp_path / "base.csv"
    base.write_text(baseline.text(book(FACT).values()))
    assert main(["gate", str(study(tmp_path / "a")), "--baseline", str(base)]) == 4
    said = capsys.readouterr().out.splitlines()
    assert said[0].startswith("case tide has changed since the baseline (digest aa -> ")
    assert any(line.startswith("missing: tide pbd h=0.01") for line in said)


def test_a_better_number_is_no_pass():
    assert exit_code(compare({FACT.key: replace(FACT, value=0.1)}, book(FACT))) == 1


@pytest.mark.parametrize(
    "fact, spread, rtol",
    [
        (FACT, 0.0, 1e-6),
        (FACT, 2.5e-5, 1e-3),
        (FACT, 2.6e-3, INF),
        (FACT, INF, INF),
        (COUNT, 0.0, 0.0),
        (COUNT, 4.0, INF),
        (WORD, 0.0, 0.0),
    ],
)
def test_tolerances_come_from_the_spread(fact, spread, rtol):
    line = baseline.line(fact, spread, "")
    assert (
        line.rtol == rtol
        and line.held == (rtol < INF)
        and outcome(fact, line) == ("pass" if line.held else "not held")
    )


def test_what_spreads_too_far_must_still_be_there_and_be_a_number():
    line = baseline.line(FACT, INF, "")
    word = baseline.line(WORD, INF, "")
    assert outcome(replace(FACT, value=7.0), line) == "not held"
    assert outcome(replace(FACT, value=float("nan")), line) == "regressed"
    assert outcome(replace(WORD, value="many"), word) == "not held"
    assert (
        exit_code(compare({}, {line.key: line}))
        == exit_code(compare({FACT.key: FACT}, {line.key: line}))
        == 4
    )


def test_what_is_below_a_floor_is_held_below_it():
    line = baseline.line(replace(FACT, kind="max", value=3e-16, floor=1e-12), 0.0, "")
    assert (
        outcome(replace(FACT, value=9e-13), line) == "pass"
        and outcome(replace(FACT, value=2e-12), line) == "regressed"
    )


def test_the_file_is_read_as_it_was_written(tmp_path):
    lines = [
        baseline.line(f, s, 'a "why", with =cmd() and é')
        for f, s in ((FACT, 0.0), (COUNT, 50.0), (WORD, INF))
    ]
    path = tmp_path / "b.csv"
    path.write_text(baseline.text(lines), encoding="utf-8", newline="\r\n")
    assert list(baseline.read(path).values()) == lines


GOOD = "tide,pbd,h=1,state_sup,near,0.5,0.1,0,,c=1,why"


@pytest.mark.survives("spoilt baseline", "another baseline")
@pytest.mark.parametrize(
    "body, said",
    [
        (GOOD.replace("0.5", "nan"), "value is 'nan'"),
        (GOOD.replace("0.5", "inf"), "finite"),
        (GOOD.replace("0.1", "nan"), "rtol"),
        (GOOD.replace("0.1", "-1"), "negative"),
        (GOOD.replace("near", "like"), "kind is 'like'"),
        (GOOD + "\n" + GOOD, "twice"),
        (GOOD + ",more", "12 fields"),
        ('"' + GOOD, "line 2"),
        (GOOD.replace("0.5", "0,5"), "fields"),
    ],
)
def test_a_spoilt_baseline_is_an_error_that_names_file_and_line(tmp_path, body, said):
    path = tmp_path / "b.csv"
    path.write_text(",".join(baseline.COLUMNS) + "\n" + body + "\n")
    with pytest.raises(ValueError, match=r"b\.csv") as e:
        baseline.read(path)
    assert said in str(e.value)


@pytest.mark.survives("spoilt baseline")
def test_a_file_that_is_none_is_an_error(tmp_path):
    (tmp_path / "b.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ValueError, match=r"b.csv is not UTF-8"):
        baseline.read(tmp_path / "b.csv")
    (tmp_path / "c.csv").write_text("case,solver\n")
    with pytest.raises(ValueError, match=r"c.csv: the first line"):
        baseline.read(tmp_path / "c.csv")
    with pytest.raises(FileNotFoundError, match=r"no baseline"):
        baseline.read(tmp_path / "d.csv")


def test_an_update_writes_only_what_changed_and_says_from_what_to_what():
    old = book(FACT, COUNT, WORD)
    moved = (
        replace(FACT, value=0.25 * (1 + 5e-7)),
        replace(COUNT, value=310.0),
        WORD,
    )  # the first one passes
    spread = {f.key: 0.0 for f in moved}
    lines, changes = update.updated({f.key: f for f in moved}, old, spread, "more steps")
    assert lines[0] == old[FACT.key] and lines[2] == old[WORD.key]
    assert lines[1].why == "more steps" and changes == ["tide pbd h=0.01 steps: 300 -> 310"]
    lines, changes = update.updated(
        {FACT.key: replace(FACT, value=0.5)}, old, {FACT.key: 0.1}, "wild"
    )
    assert [x.held for x in lines] == [False] and len(changes) == 3
    with pytest.raises(ValueError, match="calibrate again"):
        update.updated({FACT.key: replace(FACT, value=0.5)}, old, {}, "unknown")


def test_an_update_from_a_part_of_a_study_takes_nothing_from_the_rest():
    other = replace(FACT, solver="catching_up"), replace(FACT, case="apple")
    old = book(FACT, *other)
    lines, changes = update.updated(
        {FACT.key: replace(FACT, value=0.5)}, old, {FACT.key: 0.0}, "a part"
    )
    assert [x.value for x in lines] == [0.5, *(f.value for f in other)] and lines[1:] == [
        old[f.key] for f in other
    ]
    assert len(changes) == 1


def test_where_less_is_held_than_is_not_too_little_was_compared():
    loose = [replace(FACT, parameters=f"h={k}") for k in range(2)]
    lines = book(FACT) | {f.key: baseline.line(f, INF, "") for f in loose}
    found = {f.key: f for f in (FACT, *loose)}
    assert exit_code(compare(found, lines)) == 4
    found.pop(loose[0].key)
    lines.pop(loose[0].key)
    assert exit_code(compare(found, lines)) == 0


def test_the_summary_is_harmless_and_counts_everything():
    wild = replace(FACT, case="<script>|x")
    differences = compare({wild.key: wild}, book(FACT, COUNT))
    page = format_summary(differences, exit_code(differences))
    assert (
        "<script>" not in page
        and "1 new" in count_outcomes(differences)
        and "2 missing" in count_outcomes(differences)
    )
    assert (
        set(OUTCOMES) >= {f.outcome for f in differences}
        and format_lines([])[-1] == "nothing to compare"
    )


def test_the_summary_lists_so_many_findings_and_counts_the_rest():
    found = [replace(FACT, metric=f"number {k}") for k in range(MAX_FINDINGS_LISTED + 3)]
    differences = compare({f.key: f for f in found}, {})
    page = format_summary(differences, 1)
    assert page.count("| new |") == MAX_FINDINGS_LISTED and page.endswith("… and 3 more.\n")
    assert "more." not in format_summary(differences[3:], 1)


def study(folder, factor=1.0):
    """Results on disk: one case, one method, an error that halves with the step, times a factor."""
    h = 0.1 / np.unique(np.round(4 * 2 ** np.arange(0, 6.4, 0.35)))
    rows = [
        row("tide", "pbd", float(v), state_sup=float(factor * v), impulse=float(2 * factor * v))
        for v in h
    ]
    folder.mkdir()
    tables.write_tables(folder, rows)
    return folder


def test_the_commands_compare_update_and_hold(tmp_path, capsys):
    a = study(tmp_path / "a")
    b = study(tmp_path / "b", 1.01)
    base = tmp_path / "base.csv"
    gate = ["gate", str(a), "--baseline", str(base)]
    assert main(["compare", str(a), str(a)]) == 0 and "regressed" not in capsys.readouterr().out
    assert (
        main(["compare", str(a), str(b)]) == 0
        and "state constant: was 1, is 1.01" in capsys.readouterr().out
    )
    assert main([*gate, "--update"]) == 2 and "--reason" in capsys.readouterr().err
    assert (
        main([*gate, "--update", "--reason", "first"]) == 2
        and "calibrate" in capsys.readouterr().err
    )
    found = facts(read(a))
    spread = spreads.spreads(found, [found])
    (a / "calibration.csv").write_text(
        spreads.text(spread, {k: replace(f, config="case=other") for k, f in found.items()})
    )
    assert (
        main([*gate, "--update", "--reason", "first"]) == 2
        and "calibrate" in capsys.readouterr().err
    )
    (a / "calibration.csv").write_text(spreads.text(spread, found))
    assert main([*gate, "--update", "--reason", "first"]) == 0 and main(gate) == 0
    before = base.read_bytes()
    assert main([*gate, "--update", "--reason", "again"]) == 0 and base.read_bytes() == before
    page = tmp_path / "page.md"
    assert (
        main(["gate", str(b), "--baseline", str(base), "--summary", str(page)]) == 1
        and "not as in" in page.read_text()
    )


@pytest.mark.parametrize("kind, over", [("max", 1), ("min", -1), ("near", 1), ("near", -1)])
def test_a_number_that_is_off_by_all_that_is_allowed_passes(kind, over):
    fact = replace(FACT, kind=kind)
    line = replace(baseline.line(fact, 0.0, ""), atol=0.125, rtol=0.0)
    at = {fact.key: replace(fact, value=0.25 + over * 0.125)}
    beyond = {fact.key: replace(fact, value=0.25 + over * 0.1251)}
    assert compare(at, {line.key: line})[0].outcome == "pass"
    assert compare(beyond, {line.key: line})[0].outcome != "pass"
