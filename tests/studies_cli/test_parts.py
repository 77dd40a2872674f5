"""Parts of a study by several processes: the same values, stored as they end, nothing left."""

import json
import math
import operator
import os
import signal
import time
from multiprocessing import active_children

import pytest

from nsbench.cli import main
from nsbench.execute.workers.chores import chore_workers
from nsbench.execute.workers.worker import LostChore
from nsbench.studies.finding import Effort
from nsbench.studies.lemma import study as lemma
from nsbench.studies.part_journal import PartJournal
from nsbench.studies.parts import Part

ROOTS = [Part(f"root {n}", f"root of {n}", math.sqrt, (n,)) for n in range(5)]
SLOW_FIRST = [Part("slow", "a slow one", time.sleep, (1.0,)), *ROOTS]


def run(parts, workers=None, path=None, report=lambda line: None):
    return Effort(True, PartJournal(path), report, workers).parts(parts)


def stored(path):
    return [json.loads(line)["key"] for line in path.read_text().splitlines()]


def test_values_and_their_order_are_those_of_one_process_whichever_ends_first(tmp_path):
    path = tmp_path / "x.parts.jsonl"
    lines = []
    with chore_workers(2) as workers:
        values = run(SLOW_FIRST, workers, path, lines.append)
        assert run([Part("pid", "", os.getpid)], workers) != [os.getpid()]
        assert len(active_children()) == 2  # the second call has started no other
    assert values == run(SLOW_FIRST) == [None, *(math.sqrt(n) for n in range(5))]
    assert stored(path)[-1] == "slow" and sorted(stored(path)) == sorted(p.key for p in SLOW_FIRST)
    assert lines[0].startswith("6 parts") and lines[-1] == "a slow one (6 of 6 done)"
    assert active_children() == []


def test_only_parts_that_the_journal_lacks_are_given_to_workers(tmp_path):
    path = tmp_path / "x.parts.jsonl"
    run(ROOTS[:3], path=path)
    given = []

    def workers(tasks, on_value):
        given.extend(tasks)
        for number, (function, args) in reversed([*enumerate(tasks)]):
            on_value(number, function(*args))

    assert run(ROOTS, workers, path) == [math.sqrt(n) for n in range(5)]
    assert given == [(math.sqrt, (3,)), (math.sqrt, (4,))]


def test_what_a_part_raises_is_raised_and_what_was_finished_is_kept(tmp_path):
    path = tmp_path / "x.parts.jsonl"
    parts = [*ROOTS, Part("bad", "", operator.truediv, (1, 0)), Part("long", "", time.sleep, (60,))]
    began = time.monotonic()
    with pytest.raises(ArithmeticError, match="^ZeroDivisionError: division") as error:
        with chore_workers(1) as workers:
            run(parts, workers, path)
    assert "in a worker:\nTraceback" in error.value.__notes__[0]
    assert stored(path) == [p.key for p in ROOTS] and time.monotonic() - began < 30.0
    assert active_children() == []


def test_a_worker_that_dies_ends_the_study_with_a_sentence():
    with pytest.raises(LostChore, match="_exit was not done. The worker died with exit code 3"):
        with chore_workers(1) as workers:
            run([Part("bad", "", os._exit, (3,))], workers)


@pytest.mark.parametrize("more", [[Part("long", "", time.sleep, (60,))], []], ids=["more", "last"])
def test_an_interrupt_keeps_what_was_finished_and_leaves_no_process(tmp_path, more):
    path = tmp_path / "x.parts.jsonl"
    parts = [ROOTS[0], *more]

    def report(line):
        if "done" in line:
            os.kill(os.getpid(), signal.SIGINT)

    with pytest.raises(KeyboardInterrupt), chore_workers(2) as workers:
        run(parts, workers, path, report)
    assert stored(path) == ["root 0"] and active_children() == []


@pytest.mark.parametrize(
    "options, in_this_process",
    [
        ([], True),
        (["-j", "2"], False),
        (["--full"], False),
        (["--full", "-j", "1"], True),
        (["--memory", "2G"], False),
    ],
)
def test_workers_are_those_of_the_options(tmp_path, monkeypatch, options, in_this_process):
    seen = []

    def conduct(effort):
        seen.append(effort.workers is None)
        raise ArithmeticError

    monkeypatch.setattr(lemma, "conduct", conduct)
    monkeypatch.setattr(os, "cpu_count", lambda: 8)
    assert main(["study", "lemma", "-o", str(tmp_path), *options]) == 3
    assert seen == [in_this_process]


@pytest.mark.parametrize(
    "function, args, code, text",
    [
        (operator.truediv, (1, 0), 3, "contradicts itself"),
        (os._exit, (3,), 5, "nsbench: _exit was not done. The worker died"),
    ],
    ids=["contradiction", "death"],
)
def test_a_worker_that_fails_ends_the_study(
    tmp_path, monkeypatch, capsys, function, args, code, text
):
    bad = [Part("bad", "", function, args)]
    monkeypatch.setattr(lemma, "conduct", lambda effort: effort.parts(bad))
    assert main(["study", "lemma", "-o", str(tmp_path), "-j", "2"]) == code
    assert text in "".join(capsys.readouterr())


@pytest.mark.parametrize(
    "options, text",
    [
        (["-j", "0"], "at least one worker"),
        (["-j", "2", "--dask", "tcp://127.0.0.1:1"], "give one of them"),
        (["--memory", "much"], "--memory is 'much'"),
    ],
)
def test_options_that_cannot_be_used_exit_2(tmp_path, capsys, options, text):
    assert main(["study", "lemma", "-o", str(tmp_path), *options]) == 2
    assert text in capsys.readouterr().err
