"""Rows of a small study for tests of its page, and where a test of the page looks."""

from report_rows import CASES, ENV, SOLVERS, made

DRAWN = "#answer-chart[data-drawn=yes] canvas"
BARS = {"bound_state": 0.012, "state_norm": 0.0098}  # of one method on one case
LENGTHS = {"tide": 2.0}
GROUPS = {"tide": "Complementarity", "apple": "Filippov"}


class Rows:
    """Rows with the stored descriptions that a folder of results has."""

    rows = [r | BARS if r["case"] == "apple" and r["solver"] == "pbd" else r for r in made()]
    cases = {
        name: {**known, "problem": GROUPS.get(name, "LCS"), "own_length": LENGTHS.get(name)}
        for name, known in CASES.items()
    }
    solvers = SOLVERS
    env = ENV
    extra = {}


def scroll_to(page, element):
    page.evaluate("id => document.getElementById(id).scrollIntoView()", element)


def is_in_view(page, element):
    """Is the element at the top of the window, or the page at its end?"""
    return page.evaluate(
        "id => Math.abs(document.getElementById(id).getBoundingClientRect().top) < 60"
        " || innerHeight + scrollY > document.documentElement.scrollHeight - 5",
        element,
    )
