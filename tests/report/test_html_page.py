"""The page is rendered from templates and static files that are installed, watched and escaped."""

import re
import shutil
import tomllib
from fnmatch import fnmatch
from pathlib import Path

import jinja2
import pytest
from markupsafe import Markup

import nsbench
from nsbench.execute import suite
from nsbench.report import html_page, style

FOLDER = html_page.FOLDER
PAGES = ("page.html", "player_page.html")
FILES = sorted([*(FOLDER / "templates").iterdir(), *(FOLDER / "static").iterdir()])


def test_every_template_and_static_file_is_installed():
    """Files of a folder without Python are installed only if pyproject.toml names them."""
    pyproject = FOLDER.parents[1] / "pyproject.toml"
    settings = tomllib.loads(pyproject.read_text(encoding="utf-8"))["tool"]["setuptools"]
    patterns = settings["package-data"]["nsbench.report"]
    for path in FILES:
        name = str(path.relative_to(FOLDER))
        assert any(fnmatch(name, pattern) for pattern in patterns), name


@pytest.mark.parametrize("path", FILES, ids=lambda p: p.name)
def test_an_edited_template_makes_stored_reports_stale(path, tmp_path, monkeypatch):
    """Without this a page rendered by an older template would pass for current."""
    shutil.copytree(FOLDER, tmp_path / "nsbench" / "report")
    (tmp_path / "nsbench" / "__init__.py").touch()
    monkeypatch.setattr(nsbench, "__file__", str(tmp_path / "nsbench" / "__init__.py"))
    before = suite._report_digest()
    copy = tmp_path / "nsbench" / "report" / path.relative_to(FOLDER)
    copy.write_text(copy.read_text(encoding="utf-8") + "\n", encoding="utf-8")
    assert suite._report_digest() != before


@pytest.mark.parametrize("path", FILES, ids=lambda p: p.name)
def test_lines_are_at_most_100_columns(path):
    assert max(map(len, path.read_text(encoding="utf-8").splitlines())) <= 100


def test_every_template_compiles_and_is_used():
    """Each template is a page, a section, or imported or included by another one."""
    environment = html_page._environment()
    sources = {p.name: p.read_text(encoding="utf-8") for p in Path(FOLDER / "templates").iterdir()}
    sections = {f"{key}.html" for key, _ in html_page.SECTIONS}
    for name in sources:
        environment.get_template(name)
        uses = (f'from "{name}" import', f'include "{name}"')
        used = any(use in text for use in uses for text in sources.values())
        assert name in PAGES or name in sections or used, name
    assert sections <= set(sources)


def test_text_is_escaped_and_a_name_that_is_not_defined_is_an_error():
    environment = html_page._environment()
    assert environment.from_string("{{ x }}").render(x="<b>") == "&lt;b&gt;"
    with pytest.raises(jinja2.UndefinedError):
        environment.from_string("{{ missing }}").render()


def test_names_break_at_separators_and_stay_escaped():
    name = html_page.allow_breaks("a_b[c=1,<d>]")
    assert name == Markup("a_<wbr>b[<wbr>c=1,<wbr>&lt;d&gt;]")


def test_sentences_are_split_at_names_of_methods_and_small_numbers():
    split = html_page.sentence_splitter(style.assign_looks(["pbd", "pbd[order=reverse]"]))
    parts = [p for p in split("pbd[order=reverse] 1.5e-3, pbdx, a[pbd], pbd.") if p[1]]
    assert parts == [
        ("method", "pbd[order=reverse]"),
        ("text", " "),
        ("number", "1.5e-3"),
        ("text", ", pbdx, a[pbd], "),
        ("method", "pbd"),
        ("text", "."),
    ]


def test_colours_are_defined_once():
    """The style sheet names colours; only paper and the ground of stored scenes are fixed there."""
    sheets = [FOLDER / "static" / name for name in html_page.STYLES]
    css = "".join(sheet.read_text(encoding="utf-8") for sheet in sheets)
    screen = css.split("@media print")[0]
    assert screen.count("#fff") == 1 and not set(style.LIGHT_THEME.values()) & set(css.split())
    used = set(style.LIGHT_THEME) | {"text", "sans", "mono"}
    assert {part.split(")")[0] for part in css.split("var(--")[1:]} <= used
    assert style.LIGHT_THEME.keys() == style.DARK_THEME.keys()
    assert len(style.PALETTE) == len(style.DARK)


def test_a_panel_keeps_its_points_when_they_are_written_from_one_to_the_next():
    points = [(97.4, 165.0), (97.0, 21.0), (97.0, 20.5), (0.3, 20.7), (0.0, 20.7), (150.0, 5.0)]
    path = "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in points)
    other = '<path d="M2 2l8 8"/><text d="1.0">M1.0 2.0</text>'
    short = html_page.relate_points(f'<svg><path d="{path}{path}" fill="none"/>{other}</svg>')
    written = re.search(r'd="([^"]*)" fill', short)[1]
    assert len(written) < 2 * len(path) - 20 and short.endswith(f'fill="none"/>{other}</svg>')
    found = []
    for polygon in written.split("M")[1:]:
        numbers = [float(v) for v in re.findall(r"-?(?:\d+\.?\d*|\.\d+)", polygon)]
        steps = zip(numbers[::2], numbers[1::2], strict=True)
        x = y = 0.0
        for a, b in steps:
            x, y = x + a, y + b
            found.append((round(x, 1), round(y, 1)))
    assert found == points * 2 and written.count("l") == 2
