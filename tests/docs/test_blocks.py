"""Every block of the documentation does what the page says when it is run from top to bottom."""

import re
import shutil
from importlib.util import find_spec
from pathlib import Path
from unittest import SkipTest

import numpy as np
import pytest

pytest.importorskip("sybil", reason="sybil runs the blocks of the pages: pip install nsbench[test]")
from doc_blocks import BlockParser, sybil_of

ROOT = Path(__file__).parents[2]
# a line on stderr, every 15 s: a machine on which nothing is compiled writes some
PROGRESS = re.compile(r"^\d+/\d+ \S+ spent, .*\n", re.M)
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


def name(path):
    return path.relative_to(ROOT).as_posix()


def has_blocks(page):
    from sybil import Document

    return bool(list(BlockParser(None)(Document(page.read_text(encoding="utf-8"), str(page)))))


@pytest.fixture
def capture(capsys):
    def call(function):
        capsys.readouterr()
        value = function()
        printed = capsys.readouterr()
        return value, printed.out + PROGRESS.sub("", printed.err)

    return call


@pytest.fixture
def runs_and_references(runs_here, monkeypatch):
    """As runs_here; references that are missing are built, by a worker as always."""
    from nsbench.execute.workers import pool
    from nsbench.source_files import opened_files

    def build(*options, **more):
        pool.run_all(*options, **more)
        opened_files._opened_by_run.clear()  # a worker that is started now has opened nothing
        return []

    monkeypatch.setattr("nsbench.execute.missing_references.run_all", build)


@pytest.mark.long
@pytest.mark.filterwarnings("default::UserWarning")
@pytest.mark.parametrize("page", [p for p in PAGES if has_blocks(p)], ids=name)
def test_blocks_of_the_page_run(page, capture, tmp_path, monkeypatch, runs_and_references):
    monkeypatch.chdir(tmp_path)
    shutil.copytree(ROOT / "reports", "reports")
    saved = np.get_printoptions()
    document = sybil_of(capture).parse(page)
    document.namespace["find_spec"] = find_spec  # for blocks that need a package: skip: next if(...)
    for example in document.examples():
        try:
            example.evaluate()
        except SkipTest as reason:
            assert str(reason)
    np.set_printoptions(**saved)
