"""Rows that come within a short time share one look at the files and one sync, and nothing else."""

import os
from itertools import count

import pytest
from solver_file import solver

from nsbench.results import row_reuse, run_key
from nsbench.results.journal import Journal, StoreError, read_journal
from nsbench.source_files import file_state
from nsbench.study import Spec
from nsbench.study.attempt import lost_run_row
from nsbench.study.plan import resolve


@pytest.fixture
def recorder(tmp_path):
    """A recorder of one run each of two solver files."""
    run_key.forget()
    specs = []
    for name in ("east", "west"):
        file = tmp_path / f"{name}.py"
        file.write_text(solver(""))
        os.utime(file, (1e9, 1e9))
        specs.append(Spec("tide", name, "h", 0.1, "", (str(file),)))
    case = resolve("tide")
    parts = {s: run_key.parts_of(s, case) for s in specs}
    keys = {s: run_key.key_of(s, parts[s]) for s in specs}
    journal = Journal(tmp_path / "out")
    yield row_reuse.RowRecorder(journal, keys, parts, {("tide", ""): case})
    journal.close()


def row(spec):
    return lost_run_row(spec, "ok", "")


def test_rows_wait_for_one_another(recorder, monkeypatch):
    clock = count()
    looks, syncs = [], []
    monkeypatch.setattr(row_reuse.time, "monotonic", lambda: 1000.0 + 0.1 * next(clock))
    monkeypatch.setattr(os, "fsync", syncs.append)
    changed_files = file_state.changed_files
    monkeypatch.setattr(
        file_state, "changed_files", lambda paths: looks.append(1) or changed_files(paths)
    )
    east, west = recorder.keys
    recorder.add(east, row(east))  # at 1000.0 s
    assert recorder.write() == [] and not read_journal(recorder.journal.path.parent)  # 0.1 s later
    recorder.add(west, row(west))
    assert recorder.write() == []  # 0.2 s later
    assert [spec for spec, _ in recorder.write()] == [east, west]  # 0.3 s later
    assert read_journal(recorder.journal.path.parent).keys() == {*recorder.keys.values()}
    assert (len(looks), len(syncs)) == (1, 1)
    assert recorder.write() == recorder.write(at_once=True) == []
    assert (len(looks), len(syncs)) == (1, 1)


def test_a_changed_file_makes_the_rows_that_wait_uncertain_that_depend_on_it(recorder):
    east, west = recorder.keys
    for spec in (east, west):
        recorder.add(spec, row(spec))
    (file,) = west.solver_files
    with open(file, "a", encoding="utf-8") as text:
        text.write("# edited\n")
    written = dict(recorder.write(at_once=True))
    assert written[east]["status"] == "ok" and written[west]["status"] == "unverified"
    assert written[west]["why"].startswith("west.py changed while runs were made")
    kept = read_journal(recorder.journal.path.parent)
    assert recorder.keys[east] in kept and recorder.keys[west] not in kept
    said = []
    recorder.report(said.append)
    assert len(said) == 1 and said[0].startswith("west.py changed while runs were made: 1 rows")


def test_rows_that_cannot_be_written_are_not_tried_again(recorder, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    (spec, *_) = recorder.keys
    monkeypatch.setattr(os, "fsync", full)
    recorder.add(spec, row(spec))
    with pytest.raises(StoreError, match="No space left"):
        recorder.write(at_once=True)
    assert recorder.write(at_once=True) == []
    assert not read_journal(recorder.journal.path.parent)
