"""Minimal case files of what random scenes have found: none is wrong, crashes or has no end any
more."""

import importlib.util
from pathlib import Path

import pytest
from randomised.judge import Scene

import nsbench

FILES = sorted((Path(__file__).parents[1] / "regressions").glob("*.py"))


def methods(path):
    """BY of a kept file: the methods that it is about."""
    spec = importlib.util.spec_from_file_location(f"kept_{path.stem}", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.BY


@pytest.mark.long
@pytest.mark.survives("silent wrong")
@pytest.mark.parametrize("path", FILES, ids=lambda p: p.stem)
def test_what_was_found_stays_mended(path):
    judged = Scene(nsbench.load_case(path))
    for spec in methods(path):
        verdict = judged.judge(spec)
        assert verdict.word not in ("wrong", "crash"), f"{spec}: {verdict.why}"
