"""Links of the page lead from a case to its rows and from the name of a case to its section."""

import re

import pytest
from report_rows import CASES, made, row

from nsbench.report import assemble, html_page, write_report


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    out = write_report(made(), tmp_path_factory.mktemp("links") / "report.html")
    return out.read_text(encoding="utf-8")


def article(page, case):
    start = page.index(f'<article class="case" id="{assemble.assign_ids(CASES)[case]}"')
    return page[start:].split("</article>")[0]


@pytest.mark.parametrize("case", CASES)
def test_a_case_leads_to_its_rows_of_the_tables(page, case):
    """The heading of the case's rows is the target, so that the link holds without scripts."""
    ids = assemble.assign_ids(CASES)
    for table in html_page.LINKED_TABLES:
        target = f"{table}-{ids[case]}"
        heads = re.findall(rf'<tr [^>]*\bid="{re.escape(target)}".*?</tr>', page, re.S)
        assert len(heads) <= 1, target
        assert f'href="#{target}"' in article(page, case) or not heads
    assert f'<tr class="group" id="orders-{ids[case]}"' in page
    assert f'id="references-{ids[case]}"' in page


def test_every_link_within_the_page_has_a_target(page):
    """Those to all runs of a case are made by the script, like their tables."""
    targets = set(re.findall(r'\sid="([^"]*)"', page))
    links = set(re.findall(r'<a href="#([^"]*)"', page))
    assert {t for t in links - targets if not t.startswith("runs-")} == set()


def test_a_named_case_leads_to_its_section(page):
    table = page[page.index('<table id="t-choice"') :].split("</table>")[0]
    assert '<a href="#hex_n_19">hex[<wbr>n=19]</a>' in table


def test_words_in_other_columns_are_no_links(tmp_path):
    """A case may be called as a cell of any table reads."""
    rows = [row("not located", "pbd", h, state_sup=h, seconds=1.0) for h in (0.1, 0.05, 0.02)]
    page = write_report(rows, tmp_path / "r.html").read_text(encoding="utf-8")
    table = page[page.index('<table id="t-orders"') :].split("</table>")[0]
    cells = [cell for cell in re.findall(r"<td[^>]*>.*?</td>", table, re.S) if "located" in cell]
    assert cells and not any("<a" in cell for cell in cells)


@pytest.mark.parametrize(
    "name",
    ["orders-tide", "runs-tide", "errors-tide", "references-tide", "citations-tide"],
)
def test_a_case_cannot_take_the_place_of_the_rows_of_another(name):
    assert assemble.assign_ids([name])[name] == f"case_{name}"


def test_a_method_in_a_sentence_leads_to_its_sources(page):
    said = page[page.index('<section id="verdict"') :].split("</section>")[0]
    (target,) = set(
        re.findall(r'<a class="m" href="#(citations-m\d+)">(?:(?!</a>).)*>pbd</a>', said)
    )
    row = re.search(rf'<tr [^>]*id="{target}".*?</tr>', page, re.S)[0]
    assert "mueller2007" in row and "@article{mueller2007," in page


def test_a_case_gives_the_error_of_its_reference(page):
    for case, known in CASES.items():
        own = article(page, case)
        if "state" in known.get("certificate", {}):
            assert "its own error is at most" in own
            assert f'<a href="#references-{assemble.assign_ids(CASES)[case]}">How it was' in own
