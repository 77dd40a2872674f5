"""A baseline that is not that of the results is never passed: exit code 4, 2 or 1, and NaN never
0."""

import math

import numpy as np
import pytest
from report_rows import row

from nsbench.cli import main
from nsbench.gate import baseline
from nsbench.gate.facts import facts
from nsbench.report.data import read
from nsbench.results import tables

STEPS = 0.1 / np.unique(np.round(4 * 2 ** np.arange(0, 6.4, 0.35)))


def results(folder, change=lambda r: r):
    folder.mkdir()
    tables.write_tables(
        folder,
        [
            change(row("tide", "pbd", float(h), state_sup=float(h), impulse=float(2 * h)))
            for h in STEPS
        ],
    )
    return folder


@pytest.fixture
def gate(tmp_path, capsys):
    """(folder, edit of the baseline's lines) -> exit code and what was said; the baseline is that
    of sound results."""
    sound = results(tmp_path / "sound")
    path = tmp_path / "b.csv"
    lines = baseline.text(
        [baseline.line(f, 0.0, "first") for f in facts(read(sound)).values()]
    ).splitlines(keepends=True)

    def ask(folder=sound, edit=lambda lines: lines):
        path.write_text("".join(edit(list(lines))))
        code = main(["gate", str(folder), "--baseline", str(path)])
        said = capsys.readouterr()
        return code, said.out + said.err

    return ask


def with_value(lines, word):
    """Lines with another word in the place of the value."""
    return [lines[0], *(",".join([*k.split(",")[:5], word, *k.split(",")[6:]]) for k in lines[1:])]


@pytest.mark.survives("another baseline")
def test_what_is_as_in_the_baseline_passes(gate):
    assert gate()[0] == 0


@pytest.mark.survives("another baseline")
@pytest.mark.parametrize(
    "edit, code, said",
    [
        (lambda lines: lines[:-1], 4, "new"),
        (lambda lines: [*lines, lines[-1].replace("tide", "other")], 4, "missing"),
        (lambda lines: [k.replace("case=", "case=0") for k in lines], 4, "configuration differs"),
        (lambda lines: lines[:1], 4, "new"),
        (lambda lines: [*lines, lines[-1]], 2, "twice"),
        (lambda lines: with_value(lines, "nan"), 2, "value is 'nan'"),
        (lambda lines: with_value(lines, "one"), 2, "value is 'one'; a finite number is needed"),
    ],
)
def test_other_lines_are_told_and_do_not_pass(gate, edit, code, said):
    found, told = gate(edit=edit)
    assert found == code and said in told, told


@pytest.mark.survives("another baseline")
@pytest.mark.parametrize("value", [math.nan, math.inf, 0.0])
def test_a_number_that_is_none_never_passes(gate, tmp_path, value):
    broken = results(tmp_path / "broken", lambda r: r | {"state_sup": value})
    code, told = gate(broken)
    assert code in (1, 4) and "pass," not in told.splitlines()[0], told
