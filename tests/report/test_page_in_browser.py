"""The page in a browser without network: it draws, answers, and says nothing on the console."""

import pytest
from page_rows import BARS, DRAWN, Rows, is_in_view, scroll_to
from report_rows import SOLVERS, made

from nsbench import write_report
from nsbench.report.charts.layouts import MARKS
from nsbench.report.style import assign_looks


class Barred(Rows):
    """The same rows, all with error bars, and a method with a long name."""

    long = "pbd[order=random,seed=2]"
    solvers = SOLVERS | {long: SOLVERS["pbd"]}
    rows = [r | BARS | ({"solver": name} if name else {}) for name in ("", long) for r in made()]


@pytest.mark.long
def test_links_within_the_page_and_into_it_land_where_they_lead(open_page, file):
    """Sections far down have no height yet when a jump begins."""
    page = open_page()
    page.wait_for_selector(DRAWN)
    cases = page.evaluate("nsbench.data.cases.map((one) => one.id)")
    for element in ("orders", "environment", cases[-1]):
        page.evaluate("id => document.querySelector(`a[href='#${id}']`).click()", element)
        page.wait_for_timeout(1800)
        assert is_in_view(page, element)
        opened = open_page(f"{file}#{element}")
        opened.wait_for_timeout(1800)
        assert is_in_view(opened, element)


@pytest.mark.long
def test_nothing_is_fetched_and_nothing_is_said(page, file):
    cases = page.evaluate("nsbench.data.cases.map((one) => one.id)")
    for element in ("explore-chart", "scatter-chart", "bars-chart", "orders-chart", *cases):
        scroll_to(page, element)
        page.wait_for_timeout(150)
    page.wait_for_selector("#orders-chart[data-drawn]")
    page.wait_for_selector("article .chart[data-drawn]")
    assert page.said == []
    assert [url for url in page.requests if not url.startswith("data:")] == [file]


def test_points_of_orders_without_a_verdict_are_hollow(page):
    scroll_to(page, "orders-chart")
    page.wait_for_selector("#orders-chart[data-drawn=yes]")
    drawn = page.evaluate(
        """() => {
            const view = nsbench.drawn.get(document.getElementById('orders-chart')).result.view;
            const found = [];
            const visit = (item) => {
                if (item.mark?.marktype === 'symbol' && item.mark.role === 'mark') {
                    found.push([item.datum.verdict, item.fillOpacity, item.stroke]);
                }
                (item.items || []).forEach(visit);
            };
            visit(view.scenegraph().root);
            return found;
        }"""
    )
    assert {verdict == "order" for verdict, _, _ in drawn} == {True, False}
    for verdict, filled, stroke in drawn:
        assert filled == (verdict == "order") and stroke.startswith("#")


def test_error_bars_stand_over_the_errors_of_their_runs(page):
    points = "nsbench.drawn.get(document.getElementById('bars-chart')).spec.datasets.points"
    scroll_to(page, "bars-chart")
    page.wait_for_selector("#bars-chart[data-drawn=yes]")
    runs = [one for one in page.evaluate(points) if one["kind"] == "run"]
    assert runs and all(0.0 < one["x"] <= one["y"] for one in runs if one["bar"] == "bound")
    page.select_option("#bars-metric", "force")
    said = page.inner_text("#bars-chart")
    assert said == "No run has both an error and an error bar of the reaction."


@pytest.mark.long
def test_a_click_on_the_legend_picks_a_method(page):
    scroll_to(page, "explore-chart")
    page.wait_for_selector("#explore-chart[data-drawn=yes]")
    signal = "() => nsbench.drawn.get(document.getElementById('explore-chart')).result.view"
    before = page.evaluate(f"({signal})().signal('pick')")
    legend = page.evaluate(
        f"""() => {{
            const view = ({signal})();
            const seen = [];
            const visit = (item) => {{
                if (item.mark?.role === 'legend-label') seen.push(item);
                (item.items || []).forEach(visit);
            }};
            visit(view.scenegraph().root);
            let x = 0, y = 0;
            for (let at = seen[1]; at; at = at.mark?.group) {{ x += at.x || 0; y += at.y || 0; }}
            const [left, top] = view.origin();
            const padding = view.padding();
            return [x + left + padding.left + 4, y + top + padding.top];
        }}"""
    )
    page.locator("#explore-chart canvas").click(position={"x": legend[0], "y": legend[1]})
    page.wait_for_timeout(300)
    picked = page.evaluate(f"({signal})().signal('pick')")
    assert not before.get("method") and len(picked["method"]) == 1


@pytest.mark.long
def test_markers_of_the_legend_are_whole_whatever_the_options_of_a_method(page):
    """A method with options has a dashed line, and its marker would be outlined by dashes."""
    scroll_to(page, "explore-chart")
    page.wait_for_selector("#explore-chart[data-drawn=yes]")
    legend = page.evaluate(
        """() => {
            const view = nsbench.drawn.get(document.getElementById('explore-chart')).result.view;
            const seen = {};
            const visit = (item) => {
                if (item.mark?.role === 'legend-symbol') {
                    seen[item.datum.value] = [item.shape, item.strokeDash ?? null];
                }
                (item.items || []).forEach(visit);
            };
            visit(view.scenegraph().root);
            return seen;
        }"""
    )
    looks = assign_looks(Rows.solvers)
    assert "pbd[order=reverse]" in legend and page.said == []
    for name, (shape, dash) in legend.items():
        assert shape == MARKS.get(looks[name].marker, shape) and dash in (None, [], [1, 0]), name


@pytest.mark.long
def test_hovering_names_the_values_of_a_run(page):
    scroll_to(page, "explore-chart")
    page.wait_for_selector("#explore-chart[data-drawn=yes]")
    spot = page.evaluate(
        """() => {
            const view = nsbench.drawn.get(document.getElementById('explore-chart')).result.view;
            const found = [];
            const visit = (item) => {
                if (item.mark?.marktype === 'symbol' && item.mark.role === 'mark') found.push(item);
                (item.items || []).forEach(visit);
            };
            visit(view.scenegraph().root);
            const [left, top] = view.origin();
            const padding = view.padding();
            const one = found[Math.floor(found.length / 2)];
            return [one.x + left + padding.left, one.y + top + padding.top];
        }"""
    )
    page.locator("#explore-chart canvas").hover(position={"x": spot[0], "y": spot[1]})
    page.wait_for_selector("#vg-tooltip-element.visible")
    words = page.inner_text("#vg-tooltip-element")
    assert "error" in words and "seconds" in words and "method" in words


@pytest.mark.long
def test_a_case_leads_to_its_rows_alone(page):
    """Rows of other cases are hidden by the filter, which names the case as it was clicked."""
    page.evaluate("document.querySelector('#apple .places a[data-filter]').click()")
    page.wait_for_timeout(1800)
    shown = page.evaluate(
        "[...document.querySelectorAll('#t-orders tbody tr:not(.group)')]"
        ".filter((row) => !row.hidden).map((row) => row.dataset.case)"
    )
    assert set(shown) == {"apple"} and page.input_value("#q") == '"apple"'
    assert is_in_view(page, "q")
    page.evaluate("document.querySelector('#apple .places .live-only a').click()")
    page.wait_for_selector("#runs-apple[open] table")


@pytest.mark.long
@pytest.mark.parametrize("words", ['"pbd" tide', 'tide "pbd"', '"tide" "pbd"', "TIDE \"pbd\""])
def test_whole_names_and_words_select_rows_together(page, words):
    page.fill("#q", words)
    shown = page.evaluate(
        "[...document.querySelectorAll('#t-orders tbody tr:not(.group)')]"
        ".filter((row) => !row.hidden).map((row) => [row.dataset.case, row.cells[0].textContent])"
    )
    assert shown == [["tide", "pbd"]]


@pytest.mark.long
def test_error_bars_stand_in_tooltips_and_runs_where_there_are_some(page):
    of_case = "(c) => nsbench.data.pairs.filter((p) => nsbench.data.cases[p.c].name === c)"
    for case, metric, shown in (("apple", "state", 1), ("apple", "force", 0), ("tide", "state", 0)):
        rows = page.evaluate(
            f"([c, y]) => nsbench.errorRows(({of_case})(c), y, 'seconds')", [case, metric]
        )
        spec = page.evaluate("rows => nsbench.spec('error', rows)", rows)
        tips = [t["field"] for one in spec["layer"] for t in one["encoding"].get("tooltip", ())]
        assert ("bar" in tips) == bool(shown)
        bars = {(r.get("method"), r.get("bar")) for r in rows if "floor" not in r["kind"]}
        assert ("pbd", "error bar (bound) 0.012, error 9.8e-3" if shown else "none") in bars
        assert ("catching_up", "none") in bars
    page.evaluate("document.querySelector('#runs-apple summary').click()")
    page.wait_for_selector("#runs-apple table")
    cells = page.locator("#runs-apple tbody td:last-child").all_text_contents()
    assert {"error bar (bound) 0.012, error 9.8e-3", "no error bar"} == set(cells)


@pytest.mark.long
def test_numbers_of_runs_are_in_per_cent_of_a_length_and_not_below_the_floor(page):
    for case, shown in (("tide", True), ("apple", False)):
        page.evaluate(f"document.querySelector('#runs-{case} summary').click()")
        page.wait_for_selector(f"#runs-{case} table")
        parts = page.locator(f"#runs-{case} td small").all_text_contents()
        assert bool(parts) == shown and all(part.endswith(" %") for part in parts)
    errors = "[[3e-3, 1e-4], [3e-9, 1e-4], [3e-9, null], [null, 1e-4]]"
    shown = page.evaluate(f"{errors}.map(([v, floor]) => explore.error(v, floor))")
    assert shown[1:3] == ["< 1e-4", "3e-9"] and shown[0] == "3e-3" and shown[3]
    parts = "[[0.03, 2], [null, 2], [1, null]].map(([v, length]) => explore.part(v, length))"
    assert page.evaluate(parts) == ["1.5 %", "", ""]


@pytest.mark.long
def test_steps_of_all_runs_are_in_full_for_screen_readers_and_by_the_keyboard(page):
    """With the digits of the rows, which a page that shows four of them would lose."""
    page.evaluate("document.querySelector('#runs-tide summary').click()")
    page.wait_for_selector("#runs-tide table")
    known = [r for r in Rows.rows if r["case"] == "tide" and r["status"] != "refused"]
    step = next(r["h"] for r in known if r["solver"] == "pbd" and len(str(r["h"])) > 15)
    stiffness = next(r["asked"] for r in known if r["solver"] == "penalty")
    said = page.locator("#runs-tide table").aria_snapshot()
    assert f"cell \"h = {step}\"" in said and f"cell \"k = {stiffness}\"" in said
    box = page.get_by_role("checkbox", name="steps in full").first
    cell = page.locator("#runs-tide td", has_text=f"h = {step}").first
    width = lambda name: cell.locator(f".{name}").bounding_box()
    assert width("full")["width"] <= 1 and width("rounded")["width"] > 5
    box.focus()
    page.keyboard.press("Space")
    assert width("full")["width"] > 50 and width("rounded") is None
    page.set_viewport_size({"width": 390, "height": 800})  # columns are narrower there
    assert width("full")["width"] < cell.bounding_box()["width"]
    page.keyboard.press("Space")
    assert width("full")["width"] <= 1 and page.said == []


@pytest.mark.long
def test_arrow_keys_go_from_case_to_case(page):
    page.mouse.click(5, 400)
    page.keyboard.press("ArrowRight")
    page.wait_for_timeout(300)
    first = page.evaluate("location.hash")
    page.keyboard.press("ArrowRight")
    page.wait_for_timeout(300)
    second = page.evaluate("location.hash")
    page.keyboard.press("ArrowLeft")
    assert first and second and first != second and page.evaluate("location.hash") == first


@pytest.mark.long
def test_dark_mode_changes_page_and_charts(page):
    light = page.evaluate("getComputedStyle(document.body).backgroundColor")
    page.emulate_media(color_scheme="dark")
    page.wait_for_timeout(500)
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") != light
    colour = page.evaluate(
        "nsbench.drawn.get(document.getElementById('answer-chart')).spec.layer[0]"
        ".encoding.color.scale.range[0]"
    )
    assert page.evaluate(
        "nsbench.drawn.get(document.getElementById('answer-chart')).result.embedOptions.config"
        ".axis.gridColor"
    ) == page.evaluate("getComputedStyle(document.documentElement).getPropertyValue('--rule')")
    assert colour.startswith("#") and page.said == []


def test_without_scripts_nothing_is_lost_but_interaction(open_page):
    page = open_page(java_script_enabled=False)
    assert page.locator("#t-ranking").is_visible()
    assert page.locator("article .panels svg").first.is_visible()
    assert not page.locator("#answer-error").is_visible()


def test_a_phone_scrolls_one_way(open_page):
    page = open_page()
    page.set_viewport_size({"width": 390, "height": 844})
    page.wait_for_selector(DRAWN)
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    beyond = (  # a section that is laid out as it comes into view cuts what lies outside of it
        "[...document.querySelectorAll('section .wrap')].filter((wrap) => "
        "wrap.getBoundingClientRect().right > "
        "wrap.closest('section').getBoundingClientRect().right + 0.5).length"
    )
    assert page.evaluate(beyond) == 0


@pytest.mark.long
@pytest.mark.parametrize("chart", ["explore-chart", "bars-chart"])
def test_the_legends_are_whole_on_a_phone(open_page, chart, tmp_path):
    """Two legends of one chart, of methods and of markers, stand one below the other."""
    page = open_page(write_report(Barred, tmp_path / "report.html").as_uri())
    page.set_viewport_size({"width": 390, "height": 844})
    page.reload()
    page.wait_for_selector(DRAWN)
    scroll_to(page, chart)
    page.wait_for_selector(f"#{chart}[data-drawn=yes]")
    right = page.evaluate(
        """(chart) => {
            const view = nsbench.drawn.get(document.getElementById(chart)).result.view;
            const seen = [];
            const visit = (item) => {
                if (item.mark?.role === 'legend') seen.push(item.x + item.bounds.width());
                (item.items || []).forEach(visit);
            };
            visit(view.scenegraph().root);
            return Math.max(...seen) + view.origin()[0];
        }""",
        chart,
    )
    assert 100 < right <= 390 - 2 * 16


def test_pictures_are_parsed_as_they_come_near_the_screen(page):
    """All of them at once keep the reader waiting. Scenes: see the tests of players."""
    assert page.locator("article noscript").count() > 1
    for element in page.evaluate("nsbench.data.cases.map((one) => one.id)"):
        scroll_to(page, element)
        page.wait_for_timeout(200)
    assert page.locator("article .static noscript").count() > 0  # the live figure stands for them


def test_paper_has_the_static_figures(page):
    page.emulate_media(media="print")
    page.evaluate("dispatchEvent(new Event('beforeprint'))")
    assert page.locator("noscript").count() == 0
    assert page.locator("article .panels svg").first.is_visible()
    assert not page.locator("#answer-error").is_visible()
