"""The answer of the page: an error chosen by the slider, cases found by class and words."""

import re

import pytest
from page_rows import DRAWN, is_in_view
from report_rows import CASES


def slide(page, position):
    """Move the slider as the keyboard does."""
    page.focus("#answer-error")
    page.keyboard.press("Home")
    for _ in range(position):
        page.keyboard.press("ArrowRight")


def ranking(page):
    return page.inner_text("#t-answer tbody")


@pytest.mark.long
def test_the_slider_changes_error_table_and_chart(page):
    label = page.inner_text("#answer-label")
    before = ranking(page)
    picture = page.locator(DRAWN).screenshot()
    slide(page, 0)
    assert label == "1e-3" and page.inner_text("#answer-label") == "1e-1"
    assert ranking(page) != before
    page.wait_for_timeout(400)
    assert page.locator(DRAWN).screenshot() != picture
    slide(page, 18)
    assert page.inner_text("#answer-label") == "1e-10"


def test_ranking_counts_what_the_static_table_counts(page):
    """Two ways to the same counts: the script at 1e-3, and the table that Python wrote."""
    static = {}
    for row in page.locator("#t-ranking tbody tr").all():
        cells = row.locator("td").all_text_contents()
        ((reached, cheapest),) = re.findall(r"^reached on (\d+)\s*(.+)", cells[2]) or [("0", "0")]
        static[cells[0]] = int(reached), cheapest.removeprefix("cheapest on ")
    live = {}
    for row in page.locator("#t-answer tbody tr").all():
        reached, cheapest = (row.locator("td").nth(k).inner_text() for k in (2, 3))
        counts = int(reached.split()[0]), cheapest.partition(" (+")[0]
        live[row.get_attribute("data-method")] = counts
    assert live and all(static[name] == counts for name, counts in live.items())
    assert "not compared" in {cheapest for _, cheapest in live.values()}


def test_refused_cases_stand_beside_failed_runs(page):
    cells = page.locator("#t-answer tbody tr td:nth-child(7)")
    told = {
        row.get_attribute("data-method"): text
        for row, text in zip(
            page.locator("#t-answer tbody tr").all(), cells.all_inner_texts(), strict=True
        )
    }
    counts = "(m) => nsbench.data.pairs.filter((p) => p.m === m && p.word === 'refused').length"
    names = page.evaluate("nsbench.data.methods.map((m) => m.name)")
    for name, text in told.items():
        refused = page.evaluate(counts, names.index(name))
        assert (f"{refused} refused" in text) == (refused > 0), name
    assert any("refused" in text for text in told.values())
    assert any("refused" not in text for text in told.values())


def test_methods_that_refuse_all_cases_of_a_class_are_named(page):
    """They have no row in the ranking of that class."""
    absent = page.locator("#answer-absent")
    counts = "nsbench.data.pairs.filter((p) => p.m === {} && p.word !== 'refused').length"
    names = page.evaluate("nsbench.data.methods.map((m) => m.name)")
    assert all(page.evaluate(counts.format(m)) for m in range(len(names))) and absent.is_hidden()
    page.fill("#answer-words", "sliding")
    page.wait_for_function("!document.getElementById('answer-absent').hidden")
    named = set(absent.inner_text().removeprefix("Refuse all of these cases: ")[:-1].split(", "))
    ranked = {row.get_attribute("data-method") for row in page.locator("#t-answer tbody tr").all()}
    assert named and {name.strip() for name in named} == {*names} - ranked
    page.fill("#answer-words", "")


def test_multipliers_without_an_order_are_told_by_their_errors(page):
    said = {
        row.get_attribute("data-method"): row.locator("td").last.inner_text()
        for row in page.locator("#t-answer tbody tr").all()
    }
    assert said["event_driven"].startswith("no order, errors ")
    assert said["pbd"].startswith("order ")


def test_an_error_below_the_floor_of_its_reference_is_said_to_be_below_it(page):
    row = page.locator("#t-answer tbody tr[data-method=event_driven] td").last
    assert row.inner_text().startswith("no order, errors ≤ ")
    tol = "nsbench.data.pairs.filter((p) => p.accuracy === 'tol')"
    page.evaluate(f"{tol}.forEach((p) => p.floors.force = 2); answer.draw()")
    assert row.inner_text() == "no order, errors < 2"


def test_a_case_is_found_by_some_of_its_parameters(page):
    """The cases are discs[n=30,seed=0] and discs[n=30,seed=1], among others."""
    words = {"discs[n=30]": 2, "discs[seed=1]": 1, "discs[seed=1,n=30]": 1, "30 discs": 2}
    for word, found in words.items():
        page.fill("#answer-words", word)
        assert page.locator("#t-answer-cases tbody tr").count() == found
    page.fill("#answer-words", "discs[n=3]")
    assert page.inner_text("#answer-sentence") == "No case has “discs[n=3]”."


def test_a_case_is_found_by_the_words_of_its_text(page):
    """Its name has none of them; a word that no case has is named, and none is for two cases."""
    said = page.locator("article .about").first.text_content().lower().split()
    name = page.locator("article h3").first.inner_text()
    word = next(w for w in said if w.isalpha() and len(w) > 4 and w not in name)
    page.fill("#answer-words", f"{name} {word}")
    assert name in page.locator("#t-answer-cases tbody").inner_text()
    page.fill("#answer-words", f"{word} plesiosaur")
    assert page.inner_text("#answer-sentence") == "No case has “plesiosaur”."


def test_classes_and_words_select_cases(page):
    groups = page.locator("#answer-group option").all_text_contents()
    assert groups[0] == "all classes" and len(groups) > 2
    page.select_option("#answer-group", groups[1])
    some = page.locator("#t-answer-cases tbody tr").count()
    page.fill("#answer-words", "tide")
    page.select_option("#answer-group", "")
    found = page.locator("#t-answer-cases tbody tr").all_text_contents()
    assert found and all(text.startswith("tide") for text in found)
    assert 0 < some < len(CASES)


@pytest.mark.long
def test_a_method_of_the_answer_leads_to_its_work_precision_chart(page):
    """Of the case in the row, with the method picked."""
    page.evaluate("document.querySelector('#t-answer-cases').closest('details').open = true")
    row = page.locator("#t-answer-cases tbody tr", has=page.locator("td.best a")).last
    case = row.locator("td").first.inner_text()
    method = row.locator("td.best").inner_text().strip()
    row.locator("td.best a").click()
    page.wait_for_selector("#explore-chart[data-drawn=yes]")
    page.wait_for_timeout(1800)
    chosen = "document.getElementById('explore-{}').selectedOptions[0].textContent"
    assert page.evaluate(chosen.format("case")) == case
    assert page.evaluate(chosen.format("cost")) == "seconds"
    view = "nsbench.drawn.get(document.getElementById('explore-chart')).result.view"
    assert page.evaluate(f"{view}.signal('pick').method") == [method]
    assert is_in_view(page, "explore") and page.said == []
