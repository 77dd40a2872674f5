"""Code of a user's file that runs in the command itself (its import, what a method refuses): it can
neither end the command unheard, nor hold it up unheard. Where it crashes in C, the command ends,
and the traceback names the file."""

from __future__ import annotations

import contextlib
import faulthandler
import os
import sys
import threading
from collections.abc import Iterator

SLOW = 20.0  # seconds after which a line says who is at work


class UserCodeExit(RuntimeError):
    """A file called os._exit where the command asked it for something."""


@contextlib.contextmanager
def guarded(what: str) -> Iterator[None]:
    """Within, os._exit of this thread raises EndsProcess, what takes longer than SLOW says so on
    standard error, and a crash in C leaves its traceback there."""
    here = (os.getpid(), threading.get_ident())
    leave = os._exit

    def refused(status):
        if (
            os.getpid(),
            threading.get_ident(),
        ) != here:  # a child of the file's own, or another thread
            leave(status)
        raise UserCodeExit(f"{what} calls os._exit({status}), which would end the command")

    notice = threading.Timer(
        SLOW,
        lambda: print(
            f"nsbench: {what} is still at work after {SLOW:g} s; Ctrl-C stops it",
            file=sys.stderr,
            flush=True,
        ),
    )
    notice.daemon = True
    notice.start()
    os._exit = refused
    crashes = not faulthandler.is_enabled()  # else somebody hears them already
    if crashes:
        faulthandler.enable(file=2)
    try:
        yield
    finally:
        os._exit = leave
        notice.cancel()
        if crashes:
            faulthandler.disable()


def solver_refuses(method, case, spec: str) -> bool:
    """Does the method refuse the case? Also where the question fails: the run puts it again, in a
    worker, and its row says what becomes of it."""
    try:
        with guarded(f"refuses of {spec}"):
            return bool(method.refuses(case))
    except (Exception, SystemExit):
        return True
