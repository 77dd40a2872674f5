"""`nsbench study`: what it prints and writes, how it goes on, what the report shows of it."""

import json
import math

import pytest

import nsbench
from nsbench.cli import main
from nsbench.report.study_pages import read_studies, read_study
from nsbench.studies import STUDIES
from nsbench.studies.finding import (
    Effort,
    EvidenceFigure,
    EvidenceTable,
    Finding,
    write_finding,
)
from nsbench.studies.lemma import study as lemma
from nsbench.studies.part_journal import PartJournal

SVG = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 4 2"><path d="M0 0h4"/></svg>'
GRAPH_FIELDS = ("name", "n", "contacts", "exact", "search", "bound", "sum_search", "sum_bound")


def finding(**changes):
    table = EvidenceTable("t", "Numbers", ("name", "C"), (("a", 0.5), ("b", None)), "a note")
    fields = {
        "name": "lemma",
        "question": "Is it <b>bounded</b>?",
        "short": "Yes.",
        "answer": "It is, by 2.",
        "evidence": ("One line.",),
        "refutation": "A counterexample.",
        "command": "nsbench study lemma",
        "tables": (table,),
        "figures": (EvidenceFigure("f", "A figure.", SVG),),
        "data": {"graphs": [{"exact": math.nan}]},
    }
    return Finding(**{**fields, **changes})


@pytest.fixture
def small_lemma(monkeypatch):
    """The study with a fraction of its work."""
    graphs = [g for g in lemma.listed_graphs(False) if g.name in ("chain8", "hex7", "hex19")]
    monkeypatch.setattr(lemma, "listed_graphs", lambda full: graphs)
    monkeypatch.setattr(lemma, "_compare_orders", lambda effort: ORDERS)
    monkeypatch.setattr(lemma, "_compare_exact_methods", list)
    monkeypatch.setattr("nsbench.studies.lemma.graph_constants.MAX_CONTACTS_OF_ORDER", 12)
    for name, value in (
        ("EXACT_INSTANCES", 5),
        ("CLIMBS", 1),
        ("PACKINGS", 8),
        ("MIXED_PACKINGS", 8),
        ("RAREST", 0.1),
        ("TAIL_RUNS", 2),
        ("TAIL_POINTS", 5),
        ("TAIL_STEPS", 1),
        ("COMPARED", 1),
        ("ANNEALING_STEPS", 1000),
        ("GEOMETRY_TRIES", 2),
        ("GEOMETRY_EXACT", 4),
        ("ANNEALING_STARTS", 1),
    ):
        monkeypatch.setattr(lemma, name, (value, value))


ORDERS = [
    {
        "name": "chain8",
        "named": {"along the packing": 1.0},
        "random": 2.0,
        "best": 1.0,
        "best_exact": 1.0,
        "evaluations_needed": 1,
    }
]


def test_list_names_every_study_with_its_question(capsys):
    assert main(["study", "list"]) == 0
    text = capsys.readouterr().out
    assert all(s.name in text and s.question in text for s in STUDIES)


def test_an_unknown_study_exits_2_with_the_nearest_name(capsys):
    assert main(["study", "lema"]) == 2
    assert "did you mean 'lemma'?" in capsys.readouterr().err


def test_an_output_that_is_a_file_exits_2(tmp_path, capsys):
    (tmp_path / "f").write_text("")
    assert main(["study", "chain", "-o", str(tmp_path / "f")]) == 2
    assert "is a file" in capsys.readouterr().err


@pytest.mark.long
def test_lemma_writes_all_fields_and_the_same_numbers_again(tmp_path, small_lemma, monkeypatch):
    monkeypatch.setattr(lemma, "GEOMETRY_DISCS", (5,))
    for name in ("a", "b"):
        assert main(["study", "lemma", "-o", str(tmp_path / name)]) == 0
    first, again = (
        json.loads((tmp_path / name / "studies" / "lemma.json").read_text()) for name in ("a", "b")
    )
    for graph in first["graphs"]:
        assert set(GRAPH_FIELDS) <= set(graph)
        assert graph["search"] <= graph["bound"] and graph["sum_search"] <= graph["sum_bound"]
        if graph["exact"] is not None:
            assert graph["search"] <= graph["exact"] <= graph["bound"]
    exact = {g["name"] for g in first["graphs"] if g["exact"] is not None}
    assert exact == {"chain8", "hex7"}
    first.pop("seconds")
    again.pop("seconds")
    assert first == again
    page = (tmp_path / "a" / "studies" / "lemma.html").read_text()
    assert first["question"] in page and "data:image/svg+xml" in page


def test_a_search_value_above_a_bound_stops_the_study():
    entry = {"name": "x", "search": 2.0, "bound": 1.0, "sum_search": 0.0, "sum_bound": 1.0}
    theory = {"instances": {"checked": 1}}
    with pytest.raises(ArithmeticError, match="exceeds its bound"):
        lemma._check_consistency([{**entry, "exact": None}], theory, {"above": 0})


def test_numbers_that_contradict_each_other_exit_3_without_a_finding(
    tmp_path, monkeypatch, capsys
):
    def conduct(effort):
        raise ArithmeticError("search 2 above bound 1")

    monkeypatch.setattr(lemma, "conduct", conduct)
    assert main(["study", "lemma", "-o", str(tmp_path)]) == 3
    assert "search 2 above bound 1" in capsys.readouterr().out
    assert not (tmp_path / "studies" / "lemma.json").exists()


def test_the_full_form_goes_on_where_it_was_interrupted(tmp_path):
    path = tmp_path / "studies" / "x.parts.jsonl"
    calls = []

    def compute(value):
        calls.append(value)
        return (value, 0.1)

    journal = PartJournal(path)
    assert journal.part("a", lambda: compute(1)) == [1, 0.1]
    with open(path, "ab") as file:
        file.write(b'{"key": "b", "sour')  # killed in the middle of a line
    resumed = PartJournal(path)
    assert resumed.part("a", lambda: compute(2)) == [1, 0.1]
    assert resumed.part("b", lambda: compute(3)) == [3, 0.1]
    assert calls == [1, 3] and resumed.reused == 1
    assert PartJournal(path).part("b", lambda: compute(4)) == [3, 0.1]


def test_parts_of_other_sources_are_computed_again(tmp_path, monkeypatch):
    path = tmp_path / "x.parts.jsonl"
    PartJournal(path).part("a", lambda: 1)
    monkeypatch.setattr("nsbench.studies.part_journal.source_digest", lambda study: "another")
    assert PartJournal(path).part("a", lambda: 2) == 2


def test_a_finding_is_stored_and_read(tmp_path):
    path = write_finding(finding(), tmp_path, 1.25, full=False)
    assert json.loads(path.read_text())["graphs"] == [{"exact": None}]
    (section,) = read_studies(tmp_path)
    assert section.answer == "It is, by 2." and section.short == "Yes."
    assert section.figures[0].svg == SVG
    ((title, table),) = section.tables
    assert title == "Numbers" and [c.text for c in table.rows[1].cells] == ["b", "–"]


def test_names_and_orders_stay_on_one_line_and_sentences_do_not(tmp_path):
    words = ("order 1.00 [1.000, 1.000]", "A sentence of the method that says what it cannot do.")
    table = EvidenceTable("t", "Words", ("order", "why"), (words,), "")
    write_finding(finding(tables=(table,)), tmp_path, 1.0, full=False)
    ((_, shown),) = read_studies(tmp_path)[0].tables
    assert [c.kind for c in shown.rows[0].cells] == ["short", ""]


def test_the_report_of_runs_has_a_section_on_studies(tmp_path):
    row = {"case": "tide", "solver": "pbd", "status": "ok", "h": 0.1, "state_sup": 1e-2}
    write_finding(finding(), tmp_path, 1.0, full=False)
    nsbench.write_report([row], tmp_path / "with" / "report.html")
    assert "Studies: questions and answers" not in (tmp_path / "with" / "report.html").read_text()

    class Runs:
        rows = [row]
        dir = tmp_path

    nsbench.write_report(Runs(), tmp_path / "report.html")
    page = (tmp_path / "report.html").read_text()
    assert "Studies: questions and answers" in page and "&lt;b&gt;bounded&lt;/b&gt;" in page
    text = (tmp_path / "report.md").read_text()
    assert "## Studies: questions and answers" in text and "studies/lemma\\_f.svg" not in text
    assert "studies/lemma_f.svg" in text


FAILURES = EvidenceTable(
    "failures",
    "Cells that did not end well",
    ("map", "method", "h", "status", "sentence"),
    (
        ("stiffness", "pbd", 0.5, "diverged", "The state grew by 5e3."),
        ("stiffness", "pbd", 0.1, "diverged", "The state grew by 71."),
        ("height", "penalty", 0.1, "unverified", "Particles overlap."),
    ),
)


def report_with(tmp_path, *findings):
    class Runs:
        rows = [
            {"case": "tide", "solver": "pbd", "status": "ok", "h": h, "state_sup": h, "impulse": h}
            for h in (0.1, 0.05, 0.02, 0.01)
        ]
        dir = tmp_path

    for found in findings:
        write_finding(found, tmp_path, 1.0, full=False)
    page = nsbench.write_report(Runs(), tmp_path / "report.html").read_text()
    return page, (tmp_path / "report.md").read_text()


def section(page, name):
    return page[page.index(f'<section id="{name}"') :].split("</section>")[0]


def test_studies_stand_in_the_menu_and_open_with_their_short_answer(tmp_path):
    page, text = report_with(tmp_path, finding(), finding(name="chain", answer="9.", short="By 9."))
    menu = page[page.index("<nav>") :].split("</nav>")[0]
    assert 'href="#study-lemma"' in menu and 'href="#study-chain"' in menu and "2 studies" in menu
    own = section(page, "studies").split('id="study-lemma"')[1]
    assert own.index("<b>Yes.</b>") < own.index("It is, by 2.")
    assert text.index("**Yes.**") < text.index("It is, by 2.")


def test_a_finding_of_an_earlier_version_has_no_short_answer(tmp_path):
    path = write_finding(finding(), tmp_path, 1.0, full=False)
    stored = json.loads(path.read_text())
    del stored["short"]
    path.write_text(json.dumps(stored))
    assert read_study(path).short == ""
    assert '<p class="short">' not in report_with(tmp_path)[0]


def test_cells_of_studies_that_failed_stand_under_the_failures(tmp_path):
    page, text = report_with(tmp_path, finding(name="stability", tables=(FAILURES,)), finding())
    own = section(page, "failures")
    assert '<a href="#study-stability">stability</a>' in own and "study-lemma" not in own
    assert own.count("The state grew by") == 1 and "Particles overlap." in own
    assert "3 cells did not end well (2 diverged, 1 unverified)" in page
    assert "2 diverged, 1 unverified" in text and text.count("Particles overlap") == 2
    assert "Cells of studies" not in report_with(tmp_path / "without", finding())[0]


def test_the_steps_that_multipliers_need_are_those_of_the_study(tmp_path):
    page, _ = report_with(tmp_path / "without", finding())
    said = section(page, "verdict")
    assert "grows like n^2" in said and "holds no number" in said
    page, _ = report_with(tmp_path, finding(name="multipliers", short="1.7 n^2 steps."))
    said = section(page, "verdict")
    assert "1.7 n^2 steps." in said and "holds no number" not in said
    assert '<a href="#study-multipliers">' in said


@pytest.mark.parametrize(
    "change, text",
    [
        ({"answer": 3}, "no text"),
        ({"tables": [{"key": "t", "title": "", "columns": ["a"], "rows": [[1, 2]]}]}, "1 values"),
        ({"figures": 1}, "no finding"),
    ],
)
def test_a_file_that_is_no_finding_is_named(tmp_path, change, text):
    path = write_finding(finding(), tmp_path, 1.0, full=False)
    path.write_text(json.dumps({**json.loads(path.read_text()), **change}))
    with pytest.raises(ValueError, match=text) as error:
        read_study(path)
    assert str(path) in str(error.value)


def test_the_small_form_and_the_full_form_choose_their_sizes():
    journal = PartJournal(None)
    assert Effort(False, journal, print).choose(1, 2) == 1
    assert Effort(True, journal, print).choose(1, 2) == 2


def test_parts_of_a_study_that_runs_methods_depend_on_the_package(monkeypatch):
    from nsbench.studies import part_journal

    def digests():
        part_journal.source_digest.cache_clear()
        return [part_journal.source_digest(name) for name in ("lemma", "fan", "plateau")]

    before = digests()
    monkeypatch.setattr(part_journal, "package_digest", lambda: "another")
    after = digests()
    part_journal.source_digest.cache_clear()
    assert [a == b for a, b in zip(after, before, strict=True)] == [True, False, False]
