"""The child's side of a supervised worker: compute what is sent, announce what is done with it.

Messages to the parent are (what, index, row): a phase of a run ("prepare", "run", "compile",
"measure"), a row ("first": it will be given again with the times of repetitions, else "row"), or
"done" after a batch of specs, or with the value of a chore and what it raised.
"""

from __future__ import annotations

import contextlib
import faulthandler
import gc
import os
import time
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from nsbench.compilation.compile_lock import lock_compilation
from nsbench.execute.cluster import same_sources
from nsbench.execute.workers import memory
from nsbench.execute.workers.kernel_schedule import KernelSchedule
from nsbench.execute.workers.output_capture import NO_RUN
from nsbench.execute.workers.parent_watch import exit_with_parent
from nsbench.execute.workers.process_state import ProcessState
from nsbench.measure import clock
from nsbench.results.row_reuse import read_by
from nsbench.study import Spec
from nsbench.study.attempt import lost_run_row, run_batch, run_one, timed_again

# new objects after which Python looks for garbage: with its 700 it looks through all modules that a
# worker has loaded, again and again, and hardly any is found
COLLECTED_AFTER = 50_000


# kinds of what a chore raised: one of these is sent back, with the text of any other
SENT_ERRORS = (ArithmeticError, LookupError, ValueError, TypeError, OSError, MemoryError)


@dataclass(frozen=True)
class Chore:
    """Work without a row, done by a worker that has no runs: function(*args).

    Function, arguments and value can be pickled.
    """

    function: Callable
    args: tuple = ()


class LostChore(Exception):
    """A worker has ended without the value of its chore; the message says why."""


def work(pipe, output, word: bytes, parent: int, locks: str, seconds: float | None = None) -> None:
    """Body of a worker: receive batches of specs and chores by `pipe`, send messages back.

    output: connection to which everything goes that runs print, with marks of `word` between them;
    parent: process whose child this is; locks: folder of the locks by which workers take turns at
    compiling; seconds: a batch ends with the run that passes them, and each run is made once (None:
    all runs are made, and timed in rounds). Returns when the parent sends None or has ended.
    """
    exit_with_parent(parent)
    _detach()
    gc.set_threshold(COLLECTED_AFTER)
    state = ProcessState(output.fileno(), word)
    state.restore()
    schedule = KernelSchedule(locks)
    messages = Messages(pipe, state)
    lock_compilation(locks, messages.announce_compilation, clock.stand)
    with contextlib.suppress(EOFError, BrokenPipeError, ConnectionResetError):  # the parent is gone
        while (task := pipe.recv()) is not None:
            messages.last = ("start", -1)
            state.restore()  # files of cases and solvers are loaded next
            if isinstance(task, Chore):
                messages.send(("done", -1, _do(task)))
                continue
            if seconds is None:
                runs = run_batch(task, messages.announce, schedule.order)
            else:
                runs = _run_for(task, messages.announce, seconds)
            _send_rows(messages, task, runs, repeated=seconds is None)
            messages.send(("done", -1, None))


def _send_rows(
    messages: Messages, specs: list[Spec], runs: Iterator[tuple[int, dict]], repeated: bool
) -> None:
    """Send each row with the number of its warnings and the data files that the run has read."""
    state = messages.state
    warnings: dict[int, int] = {}
    sent_before_timing: set[int] = set()
    for i, row in runs:
        # a row that is given again keeps the warnings of its first run
        warnings.setdefault(i, len(state.warned))
        state.mark_output(NO_RUN)
        row_follows = repeated and i not in sent_before_timing and timed_again(specs[i], row)
        if row_follows:
            sent_before_timing.add(i)
        row = {k: _to_python_type(v) for k, v in row.items()} | {"warnings": warnings[i]}
        read = read_by(specs[i])
        what = "first" if row_follows else "row"
        messages.send((what, i, row | ({"read": read} if read else {})))


def _run_for(specs: list[Spec], announce: Callable[[str, int], None], seconds: float):
    """Yield (index, row) of the first specs, as many as end within so many seconds.

    A row with items by their names as "unlike" was not, or not for certain, made of what the client
    has (nsbench.execute.cluster.same_sources).
    """
    start = time.monotonic()
    for i, spec in enumerate(specs):
        if i and time.monotonic() - start > seconds:
            return
        unlike = same_sources.source_mismatch(spec)
        if unlike:
            row = lost_run_row(spec, "error", "not made")
        else:
            row = run_one(spec, lambda what, i=i: announce(what, i))
            unlike = same_sources.find_touched_files(spec)
        yield i, row | ({"unlike": unlike} if unlike else {})


def _detach() -> None:
    """Lead a process group of its own, write no core files, print tracebacks of crashes in C.

    Signals of the terminal are then for the parent alone, and what runs start ends with the worker.
    """
    with contextlib.suppress(OSError, AttributeError):
        os.setpgid(0, 0)
    with contextlib.suppress(ImportError, ValueError, OSError):
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, resource.getrlimit(resource.RLIMIT_CORE)[1]))
    memory.prefer_as_oom_victim()
    faulthandler.enable(file=2)


class Messages:
    """Messages of a worker about its runs: the phase of each, and kernels compiled on the way.

    state: restored where a phase begins (None: not restored).
    """

    def __init__(self, pipe, state: ProcessState | None = None):
        self.pipe = pipe
        self.pid = os.getpid()
        self.state = state
        self.last = ("start", -1)

    def announce(self, phase: str, i: int) -> None:
        """Announce a phase of run i; the repetition of a run ("again") is sent as "run"."""
        if self.state is not None:
            self._restore_state(phase, i)
        self.last = ("run" if phase == "again" else phase, i)
        self.send((*self.last, None))

    def send(self, message: tuple) -> None:
        """Send a message to the parent.

        A process that a run has forked, and that came back from the run as the worker does, ends
        here instead.
        """
        if os.getpid() != self.pid:
            os._exit(1)
        self.pipe.send(message)

    def _restore_state(self, phase: str, i: int) -> None:
        if phase == "prepare":  # a run begins
            self.state.restore()
            self.state.mark_output(i)
        elif phase == "run":
            self.state.seed_random_numbers()
        elif phase in ("again", "measure"):
            # repetitions come between those of other runs, and references that are built while
            # measuring are used by later runs: neither must depend on what a run has changed
            self.state.restore(begins=False)

    @contextlib.contextmanager
    def announce_compilation(self) -> Iterator[None]:
        """Announce that a kernel is compiled within: the clock of the run stands still."""
        before = self.last
        self.announce("compile", before[1])
        try:
            yield
        finally:
            self.announce(*before)


def _to_python_type(value):
    """Convert to Python's own types: the parent may not know those of a solver's file."""
    value = value.item() if hasattr(value, "item") else value
    return next((kind(value) for kind in (bool, int, float, str) if isinstance(value, kind)), value)


def _do(chore: Chore) -> tuple[object, Exception | None]:
    """Return the value of a chore and None, or None and what it raised, which says where."""
    try:
        return chore.function(*chore.args), None
    except Exception as e:
        kind = next((k for k in SENT_ERRORS if isinstance(e, k)), RuntimeError)
        sent = kind(str(e) if type(e) is kind else f"{type(e).__name__}: {e}")
        sent.add_note(f"in a worker:\n{traceback.format_exc()}")
        return None, sent
