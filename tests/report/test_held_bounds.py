"""Claimed bounds: relative to the size of the state, and not known where the reference is not."""

from report_rows import SOLVERS, row

from nsbench.columns import RELATIVE
from nsbench.report import assemble, data, expectations, summary, verdict


def bounded(case, error, **more):
    return row(case, "event_driven", 1e-12, "tol", state_sup=error, seconds=1e-3, **more)


def read(rows):
    return data.build(data.columns_of(rows), solvers=SOLVERS)


def said(rows):
    found = read(rows)
    statements = verdict.write_verdict(found, summary.summarise(found))
    return " ".join(next(s for s in statements if s.head == "Which orders").sentences)


def test_what_the_reference_cannot_tell_is_not_known_and_neither_kept_nor_missed():
    blind = bounded("a", 1e-9, state_floor=1e-7)
    alone = said([blind])
    assert f"claims, 1e-9 ({RELATIVE}), is not known to be kept on a, where" in alone
    assert "0 of" not in alone
    both = said([blind, bounded("b", 1e-12), bounded("c", 1e-3)])
    assert "is kept on 1 of 2 cases; missed on c (1e-3 > 1e-9); not known to be kept on a," in both
    two = read([blind, bounded("b", 1e-12)])
    judged = expectations.judge_expectations(two, summary.summarise(two))
    assert {f.case: f.outcome for f in judged} == {"a": "open", "b": "kept"}


def test_a_bound_is_relative_to_the_size_of_the_state_in_every_sentence():
    """An error of 3e-8 in a state of 300 keeps a bound of 1e-9; in a state of 1 it does not."""
    for size, kept in ((300.0, True), (1.0, False)):
        found = read([bounded("a", 3e-8, state_scale=size)])
        made = summary.summarise(found)
        state = made["a", "event_driven"].state
        assert (state.verdict == "bound kept") is kept and RELATIVE in state.sentence
        assert bool(summary.find_silent_failures(made)) is not kept
        content = assemble.assemble_content(found, assemble.draw_figures(found))
        (line,) = content.tables["bounds"].rows
        text = "1e-10" if kept else "3e-8"
        assert line.cells[2].text == text and state.text.startswith(text)


def test_refusals_of_a_single_case_are_in_their_section_alone():
    why = "event_driven takes no such thing."
    refused = row("a", "event_driven", 1e-12, "tol", status="refused", why=why)
    ran = [row("a", "pbd", 0.1 / 2**k, state_sup=0.1 / 2**k, seconds=1e-3) for k in range(5)]
    for more, shown in (([], False), ([row("b", "pbd", 0.1, state_sup=0.1)], True)):
        found = read([refused, *ran, *more])
        tables = assemble.assemble_content(found, assemble.draw_figures(found)).tables
        assert why in str(tables["failures"].rows)
        for key in ("ranking", "orders", "bounds"):
            assert ("event_driven" in str(tables[key].rows)) is shown, key
