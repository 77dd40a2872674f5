"""Docstrings, formulas and tables reach the pages as they were meant."""

import sys
from pathlib import Path

import pytest

pytest.importorskip("sphinx", reason="the extensions of the site need nsbench[docs]")
sys.path.insert(0, str(Path(__file__).parents[2] / "docs"))
from extensions import catalogue, command_line, mathml, method_choice, plain_docstrings


def test_literals_stay_and_everything_else_is_escaped():
    text = plain_docstrings.escape("The size |c| of x_ and `h` or ``y``(k,), *p*.")
    assert text == "The size \\|c\\| of x\\_ and ``h`` or ``y``\\ (k,), \\*p\\*."


def test_what_is_laid_out_is_shown_as_it_stands():
    lines = plain_docstrings.as_rst("State a case.\n\nname    letters\nx0      (n,) start\n\nEnd.")
    assert lines[1] == "State a case." and lines[-2] == "End."
    assert "   name    letters" in lines and "::" in lines


def test_a_formula_that_cannot_be_read_is_an_error():
    assert "<msub>" in mathml.convert(r"\lambda_k", display=False)
    with pytest.raises(mathml.SphinxError, match="cannot be converted"):
        mathml.convert(r"\nosuchcommand{x", display=True)


def test_every_argument_of_every_verb_has_a_meaning():
    for name, parser in command_line.verbs().items():
        for names, text in command_line.arguments(parser):
            assert names and text is not None, name
    assert dict(command_line.arguments(command_line.verbs()["gate"]))["--update"]


def test_a_card_holds_first_line_and_equations_escaped():
    first, equations = catalogue.summary("Tide: a <point> & a floor.\n\n    y' = -1\n    y >= 0\n\nMore.")
    assert (first, equations) == ("a <point> & a floor.", "y' = -1\ny >= 0")


def test_the_cheapest_methods_are_those_of_the_rows():
    data = method_choice.read(method_choice.SAMPLE)
    lines = {(kind, error): (count, words) for kind, error, count, words in
             method_choice.cheapest_by_class(data)}
    count, words = lines["Complementarity", "1e-06"]
    assert count.endswith("of 30") and words.startswith("event_driven")
    (case,) = [line for line in method_choice.cheapest_by_case(data, 1e-3) if line[0] == "tide"]
    assert case[1] == "Complementarity" and case[2] in data.specs
