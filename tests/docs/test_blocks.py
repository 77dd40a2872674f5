"""Every block of the documentation does what the page says when it is run from top to bottom."""

import shutil
from pathlib import Path
from unittest import SkipTest

import numpy as np
import pytest

pytest.importorskip("sybil", reason="sybil runs the blocks of the pages: pip install nsbench[test]")
from doc_blocks import BlockParser, sybil_of

ROOT = Path(__file__).parents[2]
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
        return value, printed.out + printed.err

    return call


@pytest.fixture
def references_here(runs_here, monkeypatch):
    """As runs_here; references that are missing are built in this process too."""
    from runs_here import run_all

    def run_all_and_build(batches, jobs, timeout, on_row, chores=(), **more):
        for chore in () if batches else chores:
            chore.function(*chore.args)
        return run_all(batches, jobs, timeout, on_row, **more)

    monkeypatch.setattr("nsbench.execute.suite.run_all", run_all_and_build)


@pytest.mark.filterwarnings("default::UserWarning")
@pytest.mark.parametrize("page", [p for p in PAGES if has_blocks(p)], ids=name)
def test_blocks_of_the_page_run(page, capture, tmp_path, monkeypatch, references_here):
    monkeypatch.chdir(tmp_path)
    shutil.copytree(ROOT / "reports", "reports")
    saved = np.get_printoptions()
    for example in sybil_of(capture).parse(page).examples():
        try:
            example.evaluate()
        except SkipTest as reason:
            assert str(reason)
    np.set_printoptions(**saved)
