"""Sentences on one case, on references and on unfinished studies say what is true of them alone."""

from dataclasses import replace

import pytest
from report_rows import STEPS, row

import nsbench
from nsbench.reference.build import describe_attempt
from nsbench.report import cost, data, overview, scaling, verdict
from nsbench.report.answers.choices import write_headline
from nsbench.report.answers.multipliers import judge_multipliers
from nsbench.report.assemble import pushes_contacts
from nsbench.report.performance_profiles import describe_profiles
from nsbench.report.summary import summarise
from nsbench.report.tables.reliability_tables import describe_reliance, references_table


def study(steps=STEPS, **more):
    rows = [
        row("a", "pbd", float(h), state_sup=h, impulse=2 * h, seconds=1e-6 / h, **more)
        for h in steps
    ]
    return data.read(rows)


def test_the_multipliers_of_the_best_method_come_first_in_the_words_of_the_terminal():
    read = study()
    (line,) = overview.overview(read)
    first = next(judge_multipliers(read, summarise(read)))
    assert first.startswith("Best at a state error of 1e-3: pbd (h = ")
    assert line.multipliers.startswith("to ") and f": {line.multipliers} (" in first


@pytest.mark.parametrize(("families", "said"), [(["Affine"], True), ([], False)])
def test_pbd_carries_loads_where_it_ran_on_constraints(families, said):
    read = replace(study(), cases={"a": {"families": families}})
    (one,) = summarise(read).values()
    assert pushes_contacts(read, one) == said
    refused = replace(one, outcome="no constraints")
    assert not pushes_contacts(read, refused)


def test_two_integrators_without_a_witness_have_none():
    runs = "event_driven at 1e-13 against event_driven[method=rk45] at 1e-12"
    why = "the bound comes from two integrators that agree, it is not proven"
    assert "witness" not in describe_reliance("stored", f"{runs}; {why}")
    beside = "; pbd comes from 1e-2 to 3e-3 when its step is divided by four"
    assert "witness" in describe_reliance("stored", f"{runs}{beside}; {why}")


def test_what_a_reference_is_made_of_depends_on_the_system():
    assert describe_attempt(nsbench.get_case("rlc_diode")) == "two integrators, without a witness"
    assert describe_attempt(nsbench.get_case("two_discs")).endswith("and a witness (pbd)")


@pytest.mark.parametrize("loop", ["compiled", "host"])
def test_seconds_of_a_host_loop_are_called_so(loop):
    read = study(loop=loop)
    found = summarise(read)
    (line,) = overview.overview(read)
    further = cost.format_extrapolated(cost.extrapolate_cost(found["a", "pbd"], 1e-6))
    for said in (line.cells()[2], write_headline(read, found), further):
        assert ("host loop" in said) == (loop == "host")


def test_an_order_without_a_verdict_tells_no_step():
    (one,) = summarise(study(STEPS[-8:])).values()
    assert one.state.kind == "fit" and one.state.verdict == "undecided"
    assert cost.extrapolate_cost(one, 1e-6) is None and cost.expect_cost(one, 1e-6).h < 1e-6 * 1.1


def test_while_runs_are_missing_no_verdict_is_given():
    read = replace(study(), lacking="3 of 4 planned runs are missing")
    said = "3 of 4 planned runs are missing: no verdict is given yet."
    statements = verdict.write_verdict(read, summarise(read))
    assert write_headline(read, summarise(read)) == statements[0].sentences[0] == said
    assert [s.head for s in statements] == ["Not finished", verdict.FAILED]


def test_one_case_is_not_counted_over_cases():
    read = study(loop="compiled", rounds=5.0)
    assert not scaling.describe_wins(read) and not describe_profiles(read)


@pytest.mark.parametrize("kind", ["certified", "stored"])
def test_certified_is_explained_where_something_is(kind):
    read = replace(study(), cases={"a": {"reference": kind, "certificate": {"how": ""}}})
    assert ("Certified:" in references_table(read, {}).note) == (kind == "certified")
