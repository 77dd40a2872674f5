"""A warning of a user's file is shown once, however often the file is loaded."""

import warnings

import pytest

import nsbench

FILE = """
import warnings
import numpy as np
import nsbench
warnings.warn("at import")
{also}

def make(a=1.0):
    warnings.warn(f"in make of {{a}}")
    return nsbench.Case("{name}", nsbench.Complementarity(lambda xp: lambda t, x: -x), [a], [0, 1])
"""


def shown(*calls):
    """The texts of the warnings that the calls show, with all filters of numpy and numba changed
    in between, as by a run."""
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("default")
        for call in calls:
            with warnings.catch_warnings():
                warnings.simplefilter("default")
            call()
    return [str(w.message) for w in found]


def test_a_warning_is_shown_once(tmp_path):
    path = tmp_path / "warned_once.py"
    path.write_text(FILE.format(name="warned_once", also='PATTERN = "\\d"'))
    load = lambda: nsbench.load_case(path)
    (syntax, *others) = shown(load, load, lambda: nsbench.load_case(path, a=2.0), load)
    assert "invalid escape sequence" in syntax
    assert others == ["at import", "in make of 1.0", "in make of 2.0"]
    path.write_text(path.read_text().replace("at import", "after an edit"))
    assert shown(load) == ["after an edit"]


def test_a_warning_of_a_file_that_another_loads_is_shown(tmp_path):
    inner = tmp_path / "inner_warned.py"
    inner.write_text(FILE.format(name="inner_warned", also=""))
    outer = tmp_path / "outer_warned.py"
    outer.write_text(FILE.format(name="outer_warned", also=f"nsbench.load_case({str(inner)!r})"))
    load = lambda: nsbench.load_case(outer)
    # at import of either, then of make of either
    assert shown(load, load) == ["at import", "at import", "in make of 1.0", "in make of 1.0"]


def test_a_warning_before_an_error_is_shown(tmp_path):
    path = tmp_path / "warned_and_failed.py"
    path.write_text(FILE.format(name="warned_and_failed", also="1 / 0"))

    def load():
        with pytest.raises(ValueError, match="ZeroDivisionError"):
            nsbench.load_case(path)

    assert shown(load, load) == ["at import"]


def test_filters_hold_while_a_file_is_loaded(tmp_path):
    path = tmp_path / "warned_by_filter.py"
    path.write_text(FILE.format(name="warned_by_filter", also=""))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(ValueError, match="at import"):
            nsbench.load_case(path)
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("ignore")
        nsbench.load_case(path)
    assert not found
    assert shown(lambda: nsbench.load_case(path)) == ["at import", "in make of 1.0"]
