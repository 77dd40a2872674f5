"""The report tells the rows as they are: no empty cell, no lost failure, no markup from names, the
same bytes twice."""

import base64
import hashlib
import json
import re
from html.parser import HTMLParser

import numpy as np
import pytest
from report_rows import CASES, ENV, METHODS, SOLVERS, STEPS, made, row, summaries

from nsbench import write_report
from nsbench.report import assemble, markdown, style, svg_plots
from nsbench.report import data as source
from nsbench.report.charts.files import chart_library
from nsbench.report.tables import cells


class Reader(HTMLParser):
    """Cells of every table, tags seen, and whether tags close in order."""

    def __init__(self, page):
        super().__init__()
        self.cells = []
        self.tags = []
        self.stack = []
        self.open = None
        self.feed(page)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in ("meta", "input", "img", "wbr", "link"):
            self.stack.append(tag)
        if tag in ("td", "th"):
            self.open = ""

    def handle_startendtag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        assert self.stack.pop() == tag
        if tag in ("td", "th"):
            self.cells.append(self.open)
            self.open = None

    def handle_data(self, data):
        if self.open is not None:
            self.open += data


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    import pandas

    out = tmp_path_factory.mktemp("study")
    pandas.DataFrame(made()).to_parquet(out / "runs.parquet")
    t = np.linspace(0, 1, 20)
    talk = {
        "exact": [t.tolist(), (0 * t).tolist()],
        "runs": [
            {
                "solver": spec,
                "dt": dt,
                "x": np.column_stack([t, high * dt * np.cos(30 * t)]).tolist(),
            }
            for spec, high in (("euler", 1.0), ("euler[implicit=true]", 0.0))
            for dt in (0.2, 0.09, 0.04)
        ],
    }
    for name, value in (
        ("cases", CASES),
        ("solvers", SOLVERS),
        ("env", ENV),
        ("extra", {"talk_figure": talk}),
    ):
        (out / f"{name}.json").write_text(json.dumps(value))
    (out / "figures").mkdir()
    (out / "figures" / "scene_tide.svg").write_text(
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 4 3">'
        '<script>alert(1)</script><circle cx="2" cy="1" r="1"/></svg>'
    )
    assert write_report(out) == out / "report.html"
    return out


@pytest.fixture(scope="module")
def page(folder):
    return (folder / "report.html").read_text(encoding="utf-8")


@pytest.mark.long
def test_no_cell_is_empty_and_every_pair_is_there(page):
    cells = Reader(page).cells
    assert cells and all(c.strip() for c in cells)
    for table in re.findall(r'<table id="t-orders".*?</table>', page, re.S):
        for case in CASES:
            rows = re.findall(rf'<tr data-case="{re.escape(case)}".*?</tr>', table, re.S)
            assert len(rows) == len(METHODS), case


def test_every_refusal_and_failure_shows_its_sentence(page):
    for r in made():
        if r["why"]:
            told = re.sub(r"t = [\d.]+", "t = ", style.escape(r["why"]))
            assert told.split("t = ")[0] in page
    assert "More than 1e4 events at t = 0.4." in page


def test_the_page_needs_nothing_else(page):
    own = page.replace(chart_library(), "")
    for tag, attrs in Reader(own).tags:
        assert tag not in ("link", "iframe", "object", "image")
        for key in ("src", "href", "xlink:href"):
            assert re.match(r"#|data:image/svg", attrs.get(key) or "#"), attrs
        assert "style" not in attrs and not any(key.startswith("on") for key in attrs), attrs
    assert "@import" not in own and "url(" not in own.replace("url(#", "").replace("url(%23", "")
    policy = re.search(r'http-equiv="Content-Security-Policy" content="([^"]*)"', page)[1]
    assert policy.startswith("default-src &#39;none&#39;") and "unsafe" not in policy
    styles = re.findall(r"<style>(.*?)</style>", page, re.DOTALL)
    scripts = re.findall(r"<script>(.*?)</script>", page, re.DOTALL)
    assert len(styles) == 1 and len(scripts) == 2
    for text in styles + scripts:
        digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
        assert f"sha256-{digest}" in policy


@pytest.mark.survives("names")
def test_a_script_in_a_stored_picture_cannot_run(page):
    assert "<script>alert" not in page and page.count("<script>") == 2
    assert 'src="data:image/svg+xml,%3Csvg' in page


def test_the_same_rows_in_any_order_give_the_same_bytes(folder, tmp_path):
    import pandas

    rows = pandas.read_parquet(folder / "runs.parquet").sample(frac=1.0, random_state=1)
    for name in ("cases", "solvers", "env", "extra"):
        (tmp_path / f"{name}.json").write_bytes((folder / f"{name}.json").read_bytes())
    (tmp_path / "figures").mkdir()
    (tmp_path / "figures" / "scene_tide.svg").write_bytes(
        (folder / "figures" / "scene_tide.svg").read_bytes()
    )
    rows.to_parquet(tmp_path / "runs.parquet")
    write_report(tmp_path)
    names = sorted(
        p.relative_to(folder) for p in folder.rglob("*") if p.suffix in (".html", ".md", ".svg")
    )
    assert len(names) > 8
    for name in names:
        assert (tmp_path / name).read_bytes() == (folder / name).read_bytes(), name


def test_frames_rows_and_csv_read_alike(tmp_path):
    import pandas

    rows = [r for r in made() if r["case"] == "tide"]
    frame = pandas.DataFrame(rows)
    frame.to_csv(tmp_path / "runs.csv", index=False)
    want = source.read(rows).runs["tide", "pbd"]
    for other in (frame, tmp_path):
        got = source.read(other).runs["tide", "pbd"]
        for name in want.col:
            np.testing.assert_array_equal(got.col[name], want.col[name], err_msg=name)


def test_markdown_tells_the_same_tables(folder, page):
    told = (folder / "report.md").read_text(encoding="utf-8")
    lines = [line for line in told.splitlines() if line.startswith("|")]
    blocks = [[k for k in block.splitlines() if k.startswith("|")] for block in told.split("\n\n")]
    assert all(
        len({line.count("|") - line.count("\\|") for line in block}) <= 1 for block in blocks
    )
    assert "| |" not in told and "|  |" not in told
    flat = re.sub(r"<small>|<br>", " ", page)
    flat = re.sub(r"<[^>]*>", "", flat)
    for line in lines[2:]:
        for cell in line.strip("| ").split(" | "):
            word = re.sub(r"\\(.)", r"\1", cell).split(" (")[0]
            assert (
                word in ("…", "---")
                or "---" in word
                or word.replace("'", "&#39;") in flat
                or word in flat
            ), word


NASTY = [
    "<script>alert('x')</script>",
    "=cmd()|'/C calc'!A0",
    "\x1b[31mred\x1b[0m",
    "a\nb",
    "../../etc/passwd",
    "x" * 300,
    '"><img src=x onerror=1>',
    "|pipe|",
    "\u202eabc",
    "é✓",
    "scene_tide",
    "talk",
    "",
]


@pytest.mark.survives("names")
def test_names_are_text_and_nothing_else(tmp_path):
    rows = [
        row(
            n,
            "pbd",
            float(h),
            state_sup=float(h),
            seconds=1.0,
            why=n,
            status="ok" if k else "error",
        )
        for n in NASTY
        for k, h in enumerate(STEPS[:4])
    ]
    rows += [
        row(
            "tide",
            n,
            h,
            status="error" if h == 0.1 else "ok",
            why=f"{n} failed",
            state_sup=h / 99,
            seconds=1.0,
        )
        for n in NASTY
        for h in (0.1, 0.05)
    ]
    rows.append(row("tide", "pbd", 0.05, state_sup=1e-5, seconds=1e-3))
    (tmp_path / "out").mkdir()
    path = write_report(rows, tmp_path / "out")
    out = path.read_text(encoding="utf-8")
    reader = Reader(out)
    assert [t for t, _ in reader.tags].count("script") == 3 and not any(
        "onerror" in a for _, a in reader.tags
    )
    assert not any(t == "img" for t, _ in reader.tags) and all(c.strip() for c in reader.cells)
    for text_ in (out, path.with_suffix(".md").read_text(encoding="utf-8")):
        own = text_.replace(chart_library(), "")
        assert not re.search(r"[\x00-\x09\x0b-\x1f\x7f\u202e]", own)
    assert "<script" not in path.with_suffix(".md").read_text(encoding="utf-8")
    figures = sorted(p.name for p in (tmp_path / "out" / "figures").iterdir())
    assert len(figures) == 2 * (len(NASTY) + 1) + 1 and figures.count("profiles.svg") == 1
    assert all(len(f) <= 120 for f in figures)
    assert not any(f.startswith((".", "scene_", "talk")) for f in figures)
    assert [p for p in tmp_path.iterdir()] == [tmp_path / "out"]
    assert all(
        "<script" not in (tmp_path / "out" / "figures" / f).read_text(encoding="utf-8")
        for f in figures
    )


@pytest.mark.survives("all fail")
@pytest.mark.parametrize(
    "rows",
    [
        [],
        [row("tide", "pbd", 0.1, status="timeout", why="Killed after 2 s.")],
        [row("tide", "pbd", np.nan, status="refused", why="No.", loop=None)],
    ],
)
def test_a_study_without_a_number_has_a_report(rows, tmp_path):
    out = write_report(rows, tmp_path / "r.html").read_text(encoding="utf-8")
    assert "No run gave a number" in out and all(r["why"] in out for r in rows)
    assert all(c.strip() for c in Reader(out).cells)


def test_a_limit_of_its_own_is_said(page):
    assert "plateau at 3.1e-3" in page or "plateau at 3.0e-3" in page


def test_non_unique_multipliers_compare_reactions_and_show_the_selection_apart(page, folder):
    s = summaries(made())["hex[n=19]", "pbd"]
    assert s.force.metric == "reaction" and abs(s.force.order - 1) < 0.05
    article = page[page.index('<article class="case" id="hex_n_19"') :].split("</article>")[0]
    assert (
        "Selection: not an error" in article
        and "Reaction error" in article
        and "Impulse error" not in article
    )
    assert (
        page.count("Selection: not an error, hex[n=19]") == 1 and "it is not an error." in article
    )


@pytest.mark.survives("spoilt results")
def test_files_that_cannot_be_read_are_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=re.escape(str(tmp_path))):
        write_report(tmp_path)
    (tmp_path / "runs.parquet").write_bytes(b"PAR1 half a file")
    with pytest.raises(ValueError, match=r"runs\.parquet"):
        write_report(tmp_path)
    (tmp_path / "runs.parquet").unlink()
    (tmp_path / "runs.csv").write_text("case,solver,h\n")
    (tmp_path / "env.json").write_text("{")
    with pytest.raises(ValueError, match=r"env\.json"):
        write_report(tmp_path)
    (tmp_path / "env.json").write_text("[1]")
    with pytest.raises(ValueError, match=r"env\.json"):
        write_report(tmp_path)
    assert not list(tmp_path.glob("report*")) and not list(tmp_path.glob(".report*"))


@pytest.mark.survives("million rows")
def test_very_many_rows_make_a_small_page(tmp_path, monkeypatch):
    monkeypatch.setattr(assemble, "MAX_DRAWN_CASES", 1)
    h = np.tile(np.geomspace(1e-1, 1e-6, 15_000), 2)
    rows = {
        "case": np.repeat(["tide", "apple"], 15_000).tolist(),
        "solver": ["pbd"] * h.size,
        "h": h.tolist(),
        "status": ["ok"] * h.size,
        "state_sup": h.tolist(),
        "reference": ["exact"] * h.size,
    }
    path = write_report(source_frame(rows), tmp_path / "r.html")
    out = path.read_text(encoding="utf-8")
    own = path.stat().st_size - len(chart_library())
    assert own < 130_000 and "500 of 15000 runs were fitted" in out
    assert "Figures are drawn for the first 1 cases" in out
    assert [p.name for p in (tmp_path / "figures").iterdir()] == ["apple.svg"]


def source_frame(rows):
    import pandas

    return pandas.DataFrame(rows)


def test_guides_show_claims_and_the_floor_is_shaded():
    rows = [row("a", "pbd", float(h), state_sup=float(h), state_floor=1e-4) for h in STEPS]
    data = source.build(source.columns_of(rows), solvers=SOLVERS)
    drawn = assemble.draw_figures(data).panels["a"][0]
    assert "order 1" in drawn and "reference floor" in drawn
    assert "var(--shade)" in drawn and "#" + "dcd7ce" not in drawn


def test_markdown_cells_cannot_break_the_table():
    made_ = cells.Table("t", ("a",), (cells.Row((cells.Cell("x|y\n`z` <b>"),)),))
    assert markdown.render_table(made_).splitlines()[-1] == r"| x\|y \`z\` &lt;b&gt; |"


def test_a_write_that_fails_leaves_nothing_behind(tmp_path, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("nsbench.results.journal.os.replace", full)
    with pytest.raises(OSError, match="No space left"):
        write_report([row("a", "pbd", 0.1, state_sup=0.1)], tmp_path / "r.html")
    assert not [p for p in tmp_path.rglob("*") if p.is_file()]


def panel(y, far=False, failed=()):
    h = np.array([0.1, 0.05, 0.02])
    look = style.assign_looks(["pbd"])["pbd"]
    lines = (
        svg_plots.Line("pbd", look, h, np.array([0.1, 0.05, 0.02]), np.empty(0)),
        svg_plots.Line("pbd", look, h, np.asarray(y), np.asarray(failed), far=far),
    )
    return svg_plots.Panel("state", "State error", "h", lines)


def marks(drawn):
    """(x, y, kind) of every marker in the SVG: m full, o open, x a cross."""
    lines = re.findall(r'<path d="M([^"]*)"[^>]*style="marker:url\(#(\w):', drawn)
    return [(*map(float, p.split()), kind) for d, kind in lines for p in d.split("L")]


@pytest.mark.survives("error zero")
def test_a_zero_is_an_open_marker_on_the_bottom_edge_and_a_failure_a_cross_on_the_top_one():
    plain, zero = (svg_plots.draw_panel(panel(y)) for y in ([0.1, 0.05, 0.02], [0.1, 0.05, 0.0]))
    bottom = max(y for _, y, _ in marks(zero))
    low = [s for _, y, s in marks(zero) if y == bottom]
    assert low == ["o"] and len(marks(plain)) == len(marks(zero)) == 6
    assert {s for _, _, s in marks(plain)} == {"m"}
    failed = svg_plots.draw_panel(panel([0.1, 0.05, 0.02], failed=[0.2, 0.3]))
    top = min(y for _, y, _ in marks(failed))
    assert len(marks(failed)) == 8 and [s for _, y, s in marks(failed) if y == top] == ["x", "x"]


def test_errors_of_another_league_do_not_press_the_others_flat():
    def spread(drawn):
        heights = [y for _, y, _ in marks(drawn)[:3]]
        return max(heights) - min(heights)

    flat, kept = (
        svg_plots.draw_panel(panel([1e-14, 2e-14, 3e-14], far=far)) for far in (False, True)
    )
    assert spread(kept) > 4 * spread(flat) and "1e-14" in kept
