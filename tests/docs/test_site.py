"""The site is built without a warning, asks no network for anything, and holds all public names."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

import nsbench
from nsbench.case import case_names
from nsbench.cli.arguments import build_parser

ROOT = Path(__file__).parents[2]
# what a browser fetches when it opens a page
FETCHED = re.compile(
    r"""<(?:script|img|iframe|source|embed)\b[^>]*\bsrc=["']([^"']+)"""
    r"""|<link\b(?=[^>]*\brel=["'](?:stylesheet|icon|preload|modulepreload))[^>]*\bhref=["']([^"']+)"""
    r"""|@import\s+["']([^"']+)"""
)


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The pages, with warnings as errors; notebooks are run by tests/docs/test_blocks.py."""
    for module in ("sphinx", "myst_nb", "pydata_sphinx_theme"):
        pytest.importorskip(module, reason="the site needs pip install 'nsbench[docs]'")
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html"]
    command += ["-D", "nb_execution_mode=off", "-d", str(folder / "trees"), str(ROOT / "docs")]
    done = subprocess.run([*command, str(folder / "html")], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-3000:]
    return folder / "html"


@pytest.mark.long
def test_pages_fetch_nothing(site):
    pages = [*site.rglob("*.html"), *site.rglob("*.css")]
    fetched = [m for p in pages for m in FETCHED.findall(p.read_text(encoding="utf-8"))]
    assert fetched
    assert not [u for found in fetched for u in found if re.match(r"(?:https?:)?//", u)]


@pytest.mark.long
def test_formulas_are_written_when_the_pages_are_built(site):
    text = (site / "explanation" / "multipliers.html").read_text(encoding="utf-8")
    assert text.count("<math") > 5
    assert not re.search(r"<script[^>]*mathjax", text, re.I)


def test_every_public_name_is_documented(site):
    text = (site / "reference" / "api.html").read_text(encoding="utf-8")
    assert not [n for n in nsbench.__all__ if f'id="nsbench.{n}"' not in text]


def test_every_verb_and_every_case_is_there(site):
    text = (site / "reference" / "command_line.html").read_text(encoding="utf-8")
    verbs = build_parser()._subparsers._group_actions[0].choices
    assert not [v for v in verbs if f'id="nsbench-{v}"' not in text]
    text = (site / "reference" / "cases.html").read_text(encoding="utf-8")
    assert not [n for n in case_names() if f'id="case-{n}"' not in text]


def test_the_choice_of_a_method_says_from_which_day_its_rows_are(site):
    text = (site / "reference" / "choosing.html").read_text(encoding="utf-8")
    assert re.search(r"Computed from \d+ rows of the run of \d{4}-\d\d-\d\d", text)
    assert "event_driven" in text and "median" in text


def test_links_of_the_built_pages_lead_somewhere(site):
    """Also those that the generated parts make."""
    broken = []
    for page in site.rglob("*.html"):
        for link in re.findall(r'href="([^"#:]+\.html)(?:#[^"]*)?"', page.read_text("utf-8")):
            if not (page.parent / link).exists():
                broken.append((page.name, link))
    assert not broken
