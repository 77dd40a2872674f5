"""Call a user's code within a command; turn its exits and empty errors into messages.

Such code can neither end the command silently (os._exit raises UserCodeExit) nor hold it up
silently (after SECONDS_BEFORE_NOTICE a line says who is at work). Where it crashes in C, the
command ends and the traceback names the file.
"""

from __future__ import annotations

import contextlib
import faulthandler
import os
import sys
import threading
import warnings
from collections.abc import Iterator
from pathlib import Path

SECONDS_BEFORE_NOTICE = 20.0

_loading: list[Path] = []  # the files whose code is loaded now, each by the one before
_shown: set[tuple] = set()  # the warnings of such files that this process has shown


class UserCodeExit(RuntimeError):
    """Code of a user's file called os._exit in the process of the command."""


@contextlib.contextmanager
def guarded(what: str) -> Iterator[None]:
    """Guard the code within, which belongs to a user's file; what: names it in messages.

    os._exit of this thread raises UserCodeExit; other threads, and processes that the code forks,
    may still end. What takes longer than SECONDS_BEFORE_NOTICE is announced on standard error, and
    a crash in C leaves its traceback there.
    """
    guarded_thread = (os.getpid(), threading.get_ident())
    end_process = os._exit

    def refuse_exit(status: int) -> None:
        if (os.getpid(), threading.get_ident()) != guarded_thread:
            end_process(status)
        raise UserCodeExit(f"{what} calls os._exit({status}), which would end the command")

    notice = threading.Timer(SECONDS_BEFORE_NOTICE, _print_notice, (what,))
    notice.daemon = True
    notice.start()
    os._exit = refuse_exit
    print_crashes = not faulthandler.is_enabled()  # else the process has arranged for them
    if print_crashes:
        faulthandler.enable(file=2)
    try:
        yield
    finally:
        os._exit = end_process
        notice.cancel()
        if print_crashes:
            faulthandler.disable()


@contextlib.contextmanager
def loading(path: str | Path) -> Iterator[None]:
    """Load a user's file within, or build its case: each of its warnings is shown once.

    A command loads a file several times, each time as a new module, of which Python does not know
    what it has shown.
    """
    _loading.append(Path(path))
    # those of a file that it loads itself are shown with its own
    first = len(_loading) == 1
    recorded = warnings.catch_warnings(record=True) if first else contextlib.nullcontext([])
    warned: list[warnings.WarningMessage] = []
    try:
        with recorded as warned:
            yield
    finally:
        _loading.pop()
        for w in warned:
            place = (w.category, str(w.message), w.filename, w.lineno)
            if place not in _shown:
                _shown.add(place)
                warnings.showwarning(w.message, w.category, w.filename, w.lineno)


def loaded_file() -> Path | None:
    """Return the user's file whose code is being loaded; None outside of `loading`."""
    return _loading[-1] if _loading else None


def _print_notice(what: str) -> None:
    print(
        f"nsbench: {what} is still at work after {SECONDS_BEFORE_NOTICE:g} s; Ctrl-C stops it",
        file=sys.stderr,
        flush=True,
    )


def solver_refuses(method, case, spec: str) -> bool:
    """Does the method refuse the case? True also where `method.refuses` raises.

    The run asks again, in a worker, and its row gives the reason. spec: names the method.
    """
    try:
        with guarded(f"refuses of {spec}"):
            return bool(method.refuses(case))
    except (Exception, SystemExit):
        return True
