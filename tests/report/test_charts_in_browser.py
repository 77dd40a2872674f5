"""Charts of the page: saved as CSV and SVG, the error of the reference, marks on each other."""

import csv
import io
import xml.etree.ElementTree

import pytest
from report_rows import STEPS, row

from nsbench import write_report
from nsbench.report.charts import coincidence, studies

CHART = "#explore-chart"
NEAR = 1e-3  # of the error of the reference: within the errors of the methods
FAR = 1e-12
VIEW = "nsbench.drawn.get(document.querySelector('{}')).result.view"


def ladder(solver, error, seconds, floor):
    return [
        row("tide", solver, float(h), state_sup=error(float(h)), seconds=seconds / h)
        | {"state_floor": floor, "impulse": float(h)}
        for h in STEPS
    ]


def rows(floor=NEAR):
    """Two methods of the same errors in different seconds, and one that has errors of its own."""
    alone = ladder("catching_up", lambda h: 0.1 * h, 3e-6, floor)
    both = [ladder(name, lambda h: h, s, floor) for name, s in (("pbd", 1e-7), ("penalty", 9e-7))]
    exact = row("tide", "event_driven", 1e-9, "tol", state_sup=FAR, seconds=0.1)
    return [*alone, *both[0], *both[1], exact | {"state_floor": floor}]


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    """The page of these rows, as an address."""
    return write_report(rows(), tmp_path_factory.mktemp("charts") / "report.html").as_uri()


@pytest.fixture
def page(open_page):
    """The page with the chart of errors over the step."""
    opened = open_page()
    draw_over_steps(opened)
    return opened


def draw_over_steps(page):
    page.wait_for_selector("#answer-chart[data-drawn]")
    page.evaluate("id => document.querySelector(id).scrollIntoView()", CHART)
    page.wait_for_selector(f"{CHART}[data-drawn=yes]")
    page.select_option("#explore-cost", "h")
    page.wait_for_timeout(400)


def saved(page, chart, kind):
    """Name and text of the file that a button below a chart saves, pressed by the keyboard."""
    button = page.locator(f"{chart} + .save button", has_text=kind)
    with page.expect_download(timeout=15000) as waiting:
        button.focus()
        page.keyboard.press("Enter")
    with open(waiting.value.path(), encoding="utf-8", newline="") as stream:
        return waiting.value.suggested_filename, stream.read()


def test_the_rows_of_a_chart_are_saved_under_the_names_of_their_columns(page):
    name, text = saved(page, CHART, "CSV")
    found = list(csv.DictReader(io.StringIO(text)))
    assert name == "tide_state_h.csv" and {one["case"] for one in found} == {"tide"}
    runs = [one for one in found if one["solver"] == "pbd"]
    errors = {float(one["h"]): float(one["state_sup"]) for one in runs}
    assert len(errors) == len(STEPS) and set(found[0]) >= {"kind", "seconds", "status"}
    assert all(error == pytest.approx(h, rel=1e-3) for h, error in errors.items())
    assert not {"x", "y", "method", "methods", "label"} & set(found[0])
    page.select_option("#explore-metric", "force")
    page.select_option("#explore-cost", "seconds")
    page.wait_for_timeout(400)
    head = saved(page, CHART, "CSV")[1].split("\r\n")[0].split(",")
    assert "impulse" in head and head.count("seconds") == 1
    assert page.said == [] and not [url for url in page.requests if url.startswith("http")]


def test_cells_of_a_saved_table_are_quoted_where_they_must_be(page):
    values = "['a,b', 'say \"x\"', 1e-7, null, 'plain']"
    quoted = page.evaluate(f"{values}.map(save.cell).join(',') + '\\r\\n'")
    read = next(csv.reader(io.StringIO(quoted)))
    assert read == ["a,b", 'say "x"', "1e-7", "", "plain"]


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_chart_is_saved_as_it_is_drawn(open_page, scheme):
    page = open_page(color_scheme=scheme)
    draw_over_steps(page)
    name, text = saved(page, CHART, "SVG")
    root = xml.etree.ElementTree.fromstring(text)
    words = {e.text for e in root.iter("{http://www.w3.org/2000/svg}text")}
    assert name == "tide_state_h.svg" and {"state error", "pbd", "catching_up"} <= words
    ground = page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert next(iter(root)).get("fill") == ground
    assert page.said == []


def test_every_chart_has_buttons_and_none_where_nothing_is_drawn(page):
    for chart in ("#answer-chart", "#orders-chart", "#scatter-chart", "article .chart"):
        place = "article .live" if chart.startswith("article") else chart
        page.evaluate("found => document.querySelector(found).scrollIntoView()", place)
        page.wait_for_selector(f"{chart}[data-drawn=yes]")
        assert page.locator(f"{chart} + .save button").all_text_contents() == ["CSV", "SVG"]
        assert saved(page, chart, "CSV")[1].count("\r\n") > 2
    page.select_option("#explore-metric", "selection")
    page.wait_for_selector(f"{CHART}[data-drawn=empty]")
    assert not page.locator(f"{CHART} + .save").is_visible() and page.said == []


@pytest.mark.parametrize("floor, in_view", [(NEAR, True), (1e-20, False)])
def test_the_error_of_the_reference_is_a_band_over_the_step_and_stands_in_the_legend(
    open_page, tmp_path, floor, in_view
):
    page = open_page(write_report(rows(floor), tmp_path / "report.html").as_uri())
    draw_over_steps(page)
    text = saved(page, CHART, "SVG")[1]
    low, high = page.evaluate(f"{VIEW.format(CHART)}.scale('y').domain()")
    said = f"error of the reference, at most {'1e-3' if in_view else '1e-20'}"
    heights = page.evaluate(
        f"""() => {{
            const found = [];
            const visit = (item) => {{
                if (item.mark?.marktype === 'rect' && item.mark.role === 'mark') {{
                    found.push([item.y, item.height]);
                }}
                (item.items || []).forEach(visit);
            }};
            visit({VIEW.format(CHART)}.scenegraph().root);
            return found.filter(([, height]) => height > 1);
        }}"""
    )
    assert said in text and page.said == []
    if in_view:
        top = page.evaluate(f"{VIEW.format(CHART)}.scale('y')({floor})")
        assert heights == [[pytest.approx(top), pytest.approx(360 - top)]]
    else:
        assert not heights and low > 1e-14


def tip_over(page, method):
    """What the tooltip says over a mark of a method, as a dict by its keys."""
    spot = page.evaluate(
        f"""(method) => {{
            const view = {VIEW.format(CHART)};
            const found = [];
            const visit = (item) => {{
                const isMark = item.mark?.marktype === 'symbol' && item.mark.role === 'mark';
                if (isMark && item.datum.method === method) found.push(item);
                (item.items || []).forEach(visit);
            }};
            visit(view.scenegraph().root);
            const [left, top] = view.origin();
            const padding = view.padding();
            const one = found[Math.floor(found.length / 2)];
            return {{ x: one.x + left + padding.left, y: one.y + top + padding.top }};
        }}""",
        method,
    )
    page.mouse.move(5, 5)
    page.locator(f"{CHART} canvas").hover(position=spot)
    page.wait_for_selector("#vg-tooltip-element.visible")
    keys = page.locator("#vg-tooltip-element td.key").all_text_contents()
    values = page.locator("#vg-tooltip-element td.value").all_text_contents()
    return dict(zip(keys, values, strict=True))


def test_a_tooltip_names_all_methods_whose_marks_coincide(page):
    assert tip_over(page, "pbd")["method"] == "pbd, penalty"
    assert tip_over(page, "catching_up")["method"] == "catching_up"
    page.select_option("#explore-cost", "seconds")  # where the same errors lie apart
    page.wait_for_timeout(400)
    assert tip_over(page, "pbd")["method"] == "pbd"


def test_marks_coincide_within_a_pixel_and_by_their_kind():
    # 360 pixels are two decades up, and 640 are one across
    at = lambda method, x, y, kind="error": {"method": method, "x": x, "y": y, "kind": kind}
    points = [
        at("a", 1.0, 1.0),
        at("b", 1.0, 10.0 ** (0.4 / 180)),
        at("c", 1.0, 10.0 ** (1.5 / 180)),
        at("a", 10.0, 100.0),
        at("d", 10.0, None, "failed"),
        at("e", 10.0 ** (1 - 0.5 / 640), None, "failed"),
        at("f", 10.0 ** (1 - 2.0 / 640), None, "failed"),
        {"method": "g", "kind": "level", "y": 1.0},
    ]
    assert coincidence.coincident_methods(points) == [
        ["a", "b"],
        ["a", "b"],
        ["c"],
        ["a"],
        ["d", "e"],
        ["d", "e"],
        ["f"],
        ["g"],
    ]


def test_charts_of_files_name_them_too_and_have_the_band():
    spec = studies.error_against_step(rows())
    points = spec["datasets"]["points"]
    assert {p["methods"] for p in points if p.get("method") == "pbd"} == {"pbd, penalty"}
    band = next(p for p in points if p["kind"] == "floor")
    assert band == {"kind": "floor", "y": NEAR, "label": "error of the reference, at most 1e-3"}
