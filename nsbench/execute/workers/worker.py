"""The child's side of a supervised worker: it computes what it is sent, tells what it does, and
goes with its parent."""

from __future__ import annotations

import contextlib
import faulthandler
import os
import time
from collections.abc import Callable
from dataclasses import dataclass

from nsbench.compilation.compile_lock import lock_compilation
from nsbench.execute.cluster import same_sources
from nsbench.execute.workers import memory
from nsbench.execute.workers.kernel_schedule import KernelSchedule
from nsbench.execute.workers.output_capture import NOBODY
from nsbench.execute.workers.parent_watch import exit_with_parent
from nsbench.execute.workers.process_state import ProcessState
from nsbench.measure import clock
from nsbench.results.row_reuse import read_by
from nsbench.study.attempt import lost_run_row, run_batch, run_one, timed_again


@dataclass(frozen=True)
class Chore:
    """Work without a row, done by whichever worker has nothing else to do: function(*args), both
    picklable."""

    function: Callable
    args: tuple = ()


def work(pipe, printed, word: bytes, parent: int, locks: str, seconds: float | None = None) -> None:
    """Body of a worker: batches and chores in by `pipe`, (what, index, row) out; what runs print
    goes to `printed`, with marks of this word between the runs.

    parent: the process whose child this is; locks: folder of the locks by which workers take turns
    at compiling; seconds:
    a batch ends with the run that passes them, and each run is made once (None: all are made, and
    timed in rounds).
    """
    exit_with_parent(parent)
    _stand_alone()
    around = ProcessState(printed.fileno(), word)
    around.restore()
    turns = KernelSchedule(locks)
    news = News(pipe, around)
    lock_compilation(locks, news.compiling, clock.stand)
    with contextlib.suppress(EOFError, BrokenPipeError, ConnectionResetError):  # the parent is gone
        while (task := pipe.recv()) is not None:
            news.specs = []
            news.last = ("start", -1)
            if isinstance(task, Chore):
                around.restore()
                news.send(("done", -1, _does(task)))
                continue
            news.specs = task
            around.restore()  # files of cases and solvers are loaded next
            warned = {}
            rounds = set()
            runs = (
                run_batch(task, news.tell, turns.order)
                if seconds is None
                else _once(task, news.tell, seconds)
            )
            for i, row in runs:
                warned.setdefault(
                    i, len(around.warned)
                )  # a row that is given again was counted then
                around.prints(NOBODY)
                more = seconds is None and i not in rounds and timed_again(task[i], row)
                rounds |= {i} if more else set()
                read = read_by(task[i])
                news.send(
                    (
                        "first" if more else "row",
                        i,
                        {k: _plain(v) for k, v in row.items()}
                        | {"warnings": warned[i]}
                        | ({"read": read} if read else {}),
                    )
                )
            news.send(("done", -1, None))


def _once(specs, tell, seconds: float):
    """(index, row) of the first specs, as many as end within so many seconds. A row with items by
    their names as "unlike" was not, or not for certain, made of what was asked for."""
    start = time.monotonic()
    for i, spec in enumerate(specs):
        if i and time.monotonic() - start > seconds:
            return
        unlike = same_sources.source_mismatch(spec)
        row = (
            lost_run_row(spec, "error", "not made")
            if unlike
            else run_one(spec, lambda what, i=i: tell(what, i))
        )
        unlike = unlike or same_sources.touched(spec)
        yield i, row | ({"unlike": unlike} if unlike else {})


def _stand_alone() -> None:
    """A group of its own, so that signals of the terminal are for the parent and what runs start
    ends with the worker;
    no core files; the traceback of a run that crashes in C."""
    with contextlib.suppress(OSError, AttributeError):
        os.setpgid(0, 0)
    with contextlib.suppress(ImportError, ValueError, OSError):
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, resource.getrlimit(resource.RLIMIT_CORE)[1]))
    memory.offer_first()
    faulthandler.enable(file=2)


class News:
    """What a worker tells of itself: what it does with which run, and when a kernel is compiled on
    the way, for which the clock of the run stands still."""

    def __init__(self, pipe, around: ProcessState | None = None):
        self.pipe = pipe
        self.pid = os.getpid()
        self.around = around
        self.specs = []
        self.last = ("start", -1)

    def tell(self, what: str, i: int) -> None:
        if what == "prepare" and self.around is not None:  # a run begins
            self.around.restore()
            self.around.prints(i)
        elif what == "run" and self.around is not None:
            self.around.draw_anew()
        elif (
            what == "again" and self.around is not None
        ):  # between runs of others: none sees what they left
            self.around.restore(begins=False)
        elif (
            what == "measure" and self.around is not None
        ):  # what is found there is kept for the next runs
            self.around.restore(begins=False)
        self.last = ("run" if what == "again" else what, i)
        self.send((*self.last, None))

    def send(self, message: tuple) -> None:
        """Send a message to the parent; a process that a run has forked, and that came back from
        the run as the worker does, ends here instead."""
        if os.getpid() != self.pid:
            os._exit(1)
        self.pipe.send(message)

    @contextlib.contextmanager
    def compiling(self):
        before = self.last
        self.tell("compile", before[1])
        try:
            yield
        finally:
            self.tell(*before)


def _plain(value):
    """The value in Python's own types: the parent may not know those of a solver's file."""
    value = value.item() if hasattr(value, "item") else value
    return next((kind(value) for kind in (bool, int, float, str) if isinstance(value, kind)), value)


def _does(chore: Chore) -> bool:
    try:
        chore.function(*chore.args)
    except Exception:  # who set the chore looks after those that were not done
        return False
    return True
