"""Multipliers that the reference does not know as well as the reaction are judged by the latter."""

import dataclasses

import numpy as np
import pytest
from report_rows import STEPS, row

import nsbench
from nsbench import reference
from nsbench.measure.context import make_context
from nsbench.report import assemble, data, markdown, overview
from nsbench.study.attempt import _below

CASE = nsbench.get_case("tide")
SAID = "multipliers nearly not unique: known to 0.76 only; the reaction is compared"


def known_to(impulse, reaction, size=1.0):
    """The reference of a case with other bounds of its own error, its impulses `size` as large."""
    ref = reference.closed_form(CASE)
    bounds = {"impulse_error": impulse, "reaction_error": reaction}
    return dataclasses.replace(ref, impulse=size * ref.impulse, **bounds)


@pytest.mark.parametrize(
    "impulse, reaction, size, known",
    [
        (0.76, 3e-11, 1.0, False),
        (1e-9, 1e-15, 1.0, True),  # good enough, whatever the reaction is known to
        (1e-4, 1e-5, 1.0, True),  # the flow amplifies errors of both
        (1e-4, 1e-13, 1e6, True),  # relative to impulses of 1e6
        (float("nan"), 1e-13, 1.0, True),
    ],
)
def test_impulses_are_known_or_not_relative_to_the_reaction(impulse, reaction, size, known):
    assert known_to(impulse, reaction, size).knows_impulse is known


def test_a_run_is_measured_by_the_reaction_where_the_reference_tells_no_impulse():
    traj = nsbench.solve(CASE, "pbd", h=0.01)
    for bound, compared in ((0.76, "reaction"), (1e-13, "impulse")):
        context = make_context(CASE, known_to(bound, 3e-11))
        found = nsbench.measure.errors(CASE, traj, context)
        assert found["multipliers_unique"] and found["compared"] == compared
        # an impulse below a floor of 7.6 says nothing: the reaction decides
        seen = found | {"status": "ok", "below": "state_sup impulse"}
        assert bool(_below(seen)) is (compared == "impulse")


def nearly(case="a"):
    more = {"compared": "reaction", "impulse_floor": 7.6, "reaction_floor": 3e-10}
    return [
        row(case, "pbd", float(h), state_sup=float(h), impulse=0.3, reaction=float(h), **more)
        | {"seconds": 1e-6 / h}
        for h in STEPS
    ]


def test_all_outputs_say_why_in_the_same_words():
    read = data.read(nearly())
    (line,) = overview.overview(read)
    assert line.why_reaction == SAID and line.multipliers.startswith("reaction to 3")
    assert overview.format_overview(read)[-1] == f"a: {SAID}"
    content = assemble.assemble_content(read, assemble.draw_figures(read))
    trusted = next(s for s in content.statements if s.head == "Can the multipliers be trusted")
    assert f"a: {SAID}." in trusted.sentences
    assert "The reaction converges, with order: pbd 1.00 (1 case)." in trusted.sentences
    assert not any("impulse converges" in s for s in trusted.sentences)
    assert SAID[1:] in content.notes["a"][0]
    (reference_row,) = content.tables["references"].rows
    assert reference_row.cells[3].small == SAID
    assert "multipliers are nearly not unique" in "".join(content.panels["a"])
    assert SAID in markdown.render_markdown(content)
    assert not np.isnan(content.summaries["a", "pbd"].force.order)


def test_multipliers_that_are_not_unique_are_called_so():
    rows = [r | {"multipliers_unique": False, "compared": "reaction"} for r in nearly()]
    (line,) = overview.overview(data.read(rows))
    assert line.why_reaction == "multipliers not unique: the reaction is compared"
    assert len(overview.format_overview(data.read(rows))) == 2
