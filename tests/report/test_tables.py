"""Tables say how large a violation is in per cent, and how far a reference can be relied on."""

import json

import numpy as np
import pytest
from report_rows import CASES, row

import nsbench
from nsbench.case.scale import Scale
from nsbench.problem import Affine
from nsbench.report import assemble, data, scaling, write_report
from nsbench.report.summary import summarise
from nsbench.report.tables import (
    coarsest_table,
    error_bar_table,
    error_table,
    failure_tables,
    reliability_tables,
)
from nsbench.studies.registry import find_study
from nsbench.study.describe import describe_case


def read(**notes):
    """One case with a violation of 0.03, described by these notes."""
    rows = [row("hex", "pbd", h, state_sup=h, feasibility=0.3 * h) for h in (0.2, 0.1)]
    return data.build(data.columns_of(rows), cases={"hex": {**CASES["hex[n=19]"], **notes}})


def violation(known):
    table = error_table.error_table(known)
    (line,) = table.rows
    return line.cells[table.columns.index("violation")]


def test_a_violation_is_in_per_cent_of_the_length_of_its_case():
    assert violation(read(own_length=2.0)).text == violation(read()).text == "0.03"
    assert violation(read(own_length=2.0)).small == "1.5 %"
    assert violation(read(own_length=2.0)).title == "1.5 % of 2"
    assert violation(read()).small == violation(read(own_length=None)).small == ""


@pytest.mark.parametrize(
    "length, said", [(6.0, "below 1 % of the diameter or stated size (0.06)"), (None, "below 1e-2")]
)
def test_the_step_that_keeps_the_constraints_is_for_per_cents_of_the_own_length(length, said):
    rows = [row("hex", "pbd", h, state_sup=h, feasibility=0.03 * h) for h in (0.4, 0.2, 0.1)]
    known = data.build(data.columns_of(rows), cases={"hex": {"own_length": length}})
    text = " ".join(assemble.write_case_notes(known, "hex", summarise(known)))
    assert f"Violation {said}:" in text


def test_methods_that_keep_the_constraints_and_those_that_never_do_are_named():
    worse = {"pbd": 0.05, "kdtree": 1.0, "catching_up": 1e-12}  # violation over the step
    rows = [
        row("hex", method, h, state_sup=h, feasibility=size * h)
        for method, size in worse.items()
        for h in (0.4, 0.2, 0.1)
    ]
    for families, said in (("171 pairs of discs", True), ([], False)):
        known = data.build(data.columns_of(rows), cases={"hex": {"families": families}})
        text = " ".join(assemble.write_case_notes(known, "hex", summarise(known)))
        assert "below 1e-2: pbd h = 0.2 (" in text and "); not by kdtree at the steps" in text
        assert "below 1e-3: not by pbd, kdtree at the steps tried." in text
        assert ("No step tried violates by more than rounding: catching_up." in text) == said


def test_a_study_without_pbd_says_nothing_of_pbd():
    seen = {"loop": "compiled", "seconds": 1e-3}
    rows = [row("hex", "euler", h, state_sup=h * h, **seen) for h in (0.2, 0.1, 0.01)]
    assert scaling.describe_wins(data.build(data.columns_of(rows))) == []


def test_other_columns_have_no_per_cents():
    (line,) = error_table.error_table(read(own_length=2.0)).rows
    assert [cell.small for cell in line.cells if cell.small] == ["1.5 %"]


def test_the_length_is_the_diameter_of_particles_or_the_size_that_a_case_states():
    drift = lambda xp: lambda t, x: -x
    floor = Affine(np.eye(1), np.zeros(1))
    start = {"x0": np.ones(1), "t": np.linspace(0.0, 1.0, 3)}
    without = nsbench.Case("point", nsbench.Complementarity(drift, (floor,)), **start)
    stated = nsbench.Case(
        "point", nsbench.Complementarity(drift, (floor,)), scale=Scale(1.0, 5.0), **start
    )
    assert describe_case(nsbench.get_case("discs", n=3))["own_length"] == 2.0
    assert describe_case(stated)["own_length"] == 5.0
    assert describe_case(without)["own_length"] is None


@pytest.mark.parametrize("wrong", ["wide", 0.0, -1.0, [1.0]])
def test_a_length_that_is_none_is_refused(tmp_path, wrong):
    (tmp_path / "runs.csv").write_text("case,solver,status\nhex,pbd,ok\n")
    (tmp_path / "cases.json").write_text(json.dumps({"hex": {"own_length": wrong}}))
    with pytest.raises(ValueError, match="own_length of hex"):
        write_report(tmp_path)


RUNS = "event_driven at 1e-13 against event_driven[method=rk45] at 1e-12"


@pytest.mark.parametrize(
    ("kind", "how", "said"),
    [
        ("certified", "Taylor series of order 40", "proven to lie within it."),
        ("certified", "(0, 1) stay closed (shown to 1e-40, not proven)", "called not proven"),
        ("stored", RUNS, "Two integrators agree to half the bound, which is no proof."),
        ("stored", f"{RUNS}; pbd comes from 1e-2 to 3e-3 when", "a witness, another method"),
        ("closed form", "a certificate differs by 1.1e-16", "within a certified bound."),
        ("closed form", "", "counts roundings and is not proven"),
        ("none", "the solution is not unique", "no error is known"),
        ("unusable: of another version", "", "no error is known"),
        ("exact", "", "not told"),
    ],
)
def test_the_table_says_how_far_to_rely_on_a_reference(kind, how, said):
    known = read(reference=kind, certificate={"how": how})
    table = reliability_tables.references_table(known, {})
    (line,) = table.rows
    sentence = line.cells[table.columns.index("how far to rely on it")].text
    assert said in sentence and sentence.endswith(".") and "{" not in sentence


def test_every_stored_reference_of_the_bench_has_its_sentence():
    """A phrase that is changed where references are made would lose its meaning here."""
    for name, words in (
        ("two_discs", "A closed form within"),
        ("three_discs", "A certified bound"),
        ("epithelium", "a witness, another method"),
    ):
        stored = describe_case(nsbench.get_case(name))
        how = stored["certificate"]["how"]
        assert words in reliability_tables.describe_reliance(stored["reference"], how)


def test_refusals_with_one_sentence_are_one_line_and_failures_are_one_a_method():
    both = ("pbd", "euler")
    said = {"refused": "Not for 3 links.", "maxiter": "1500 steps were taken."}
    rows = [row("hex", m, 0.1, status=s, why=w) for m in both for s, w in said.items()]
    table = failure_tables.failures_table(data.build(data.columns_of(rows)))
    lines = [[cell.text for cell in line.cells[:4]] for line in table.rows]
    assert [line[:3] for line in lines] == [
        ["maxiter", "euler", "1"],
        ["maxiter", "pbd", "1"],
        ["refused", "pbd and euler", "2"],
    ]
    assert [line.solver for line in table.rows] == ["euler", "pbd", ""]


def with_estimates(solver, *effectivities):
    """Rows of runs of `tide` with estimates so many times their errors."""
    return [
        row("tide", solver, h, state_sup=h, state_norm=h, estimate_state=h * times)
        for h, times in zip((0.1, 0.05, 0.02), effectivities, strict=True)
    ]


def test_the_note_of_error_bars_names_the_methods_whose_estimates_are_too_small():
    """No warning stands in the rows themselves: a reader would believe an estimate of 1e-9."""
    rows = with_estimates("pbd", 1.1, 1.2, 1.3) + with_estimates("catching_up", 1.5, 0.25, 1e-9)
    table = error_bar_table.error_bar_table(summarise(data.read(rows)))
    said = "of 6 estimates of the state, 2 are below the error: catching_up on tide (down to 1e-9"
    assert said in table.note and "pbd on" not in table.note
    kinds = [r.cells[4].kind for r in table.rows]
    assert kinds == ["number", "bad"]
    table = error_bar_table.error_bar_table(summarise(data.read(rows[:3])))
    assert "of 3 estimates of the state, none is below the error." in table.note
    table = error_bar_table.error_bar_table(summarise(data.read([row("tide", "pbd", 0.1)])))
    assert "estimates of the state" not in table.note


def with_bounds(solver, *effectivities):
    """Rows of runs of `apple` with bounds of the state so many times their errors."""
    rows = with_estimates(solver, *effectivities)
    return [r | {"case": "apple", "bound_state": r.pop("estimate_state")} for r in rows]


def test_the_note_of_error_bars_tells_proven_bounds_from_estimates():
    """An estimate below the error must not be read as a proof that failed."""
    rows = with_estimates("pbd", 1.1, 0.5, 1.3) + with_bounds("pbd", 1.0, 1.2, 1.3)
    note = error_bar_table.error_bar_table(summarise(data.read(rows))).note
    assert "Of 3 proven bounds (3 of the state) none is below the error." in note
    assert note.endswith(
        "Estimates are no bounds: of 3 estimates of the state, 1 is below the error: "
        "pbd on tide (down to 0.5 times)."
    )
    rows[-1]["bound_reaction"] = rows[-1]["reaction"] = rows[-1]["reaction_norm"] = 0.1
    note = error_bar_table.error_bar_table(summarise(data.read(rows))).note
    assert "Of 4 proven bounds (3 of the state and 1 of the reaction) none is" in note
    note = error_bar_table.error_bar_table(summarise(data.read(rows[:3]))).note
    assert "proven bounds (" not in note


def test_a_proven_bound_below_the_error_is_called_a_fault():
    """However little is missing."""
    rows = with_bounds("pbd", 1.1, 1.2, 0.99996) + with_bounds("catching_up", 2.0, 2.0, 2.0)
    note = error_bar_table.error_bar_table(summarise(data.read(rows))).note
    assert note.endswith(
        "Of 6 proven bounds (6 of the state) 1 is below the error, which is a fault: "
        "pbd on apple (down to 0.999960 times)."
    )


def test_the_largest_steps_are_counted_with_their_failures_and_violations():
    """Of each case one run of each method, the coarsest that is not refused."""
    rows = [
        row("tide", "pbd", 0.1, feasibility=0.5),
        row("tide", "pbd", 0.05, feasibility=0.9),
        row("hex", "pbd", 0.1, status="diverged", feasibility=7.0),
        row("hex", "pbd", 0.2, status="refused"),
        row("apple", "pbd", 0.1, feasibility=0.3),
        row("tide", "penalty", 1 / 30, "k", asked=30.0, feasibility=0.2),
        {**row("tide", "penalty", 1e-3, "k", asked=1000.0), "h": None, "status": "timeout"},
        row("hex", "catching_up", 0.1, status="refused"),
    ]
    read = data.build(data.columns_of(rows), cases={"tide": {"own_length": 2.0}})
    table = coarsest_table.coarsest_table(read)
    lines = {r.solver: [(c.text, c.small) for c in r.cells[1:]] for r in table.rows}
    assert lines == {
        "pbd": [
            ("3", ""),
            ("1", "1 diverged"),
            ("25 %", "tide, h = 0.1"),
            ("0.3", "apple, h = 0.1"),
        ],
        "penalty": [("1", ""), ("0", ""), ("10 %", "tide, k = 30"), ("none known", "")],
    }
    assert [r.cells[2].kind for r in table.rows] == ["bad", "number"]
    assert f"nsbench study {find_study('stability').name} " in table.note
