"""Open files that others may have made: regular files of a bounded length, and nothing else.

A link can lead out of the folder that was asked for, a FIFO waits for a writer that never comes,
and a device such as /dev/zero never ends. So a path is opened without waiting, and what was opened
is looked at before a byte of it is read.
"""

from __future__ import annotations

import contextlib
import os
import stat
from pathlib import Path
from typing import BinaryIO

# of what is opened: no waiting for the other end of a FIFO, no link in the last place
OPEN_FLAGS = (
    os.O_RDONLY
    | getattr(os, "O_NONBLOCK", 0)
    | getattr(os, "O_NOFOLLOW", 0)
    | getattr(os, "O_BINARY", 0)
)


class UnusableFile(ValueError):
    """Report a file that is not read; the message names it and says why."""


class TooLong(UnusableFile):
    """Report a file that is longer than what is read of it."""


def exists(path: str | Path) -> bool:
    """Is there anything under this name, a link to nowhere included?"""
    try:
        return os.path.lexists(path)
    except (OSError, ValueError):
        return False


def open_regular(path: str | Path, most: int, folder: str | Path | None = None) -> BinaryIO:
    """Open a regular file for reading.

    most: bytes beyond which it is not read. folder: where it must lie, links followed; None: links
    may lead anywhere. Raises FileNotFoundError where nothing has this name, and UnusableFile for
    all that cannot be opened, is no regular file, lies elsewhere or is too long.
    """
    real = os.path.realpath(path)
    if folder is not None and not Path(real).is_relative_to(os.path.realpath(folder)):
        raise UnusableFile(f"{path} is a link out of {folder}; a file of its own is needed")
    try:
        number = os.open(real, OPEN_FLAGS)
    except FileNotFoundError:
        if os.path.islink(path):
            raise UnusableFile(f"{path} is a link to nowhere") from None
        raise
    except OSError as e:
        raise UnusableFile(_sentence(path, e)) from None
    with contextlib.ExitStack() as undo:
        undo.callback(os.close, number)
        state = os.fstat(number)
        if not stat.S_ISREG(state.st_mode):
            raise UnusableFile(f"{path} is no regular file")
        if state.st_size > most:
            raise TooLong(f"{path} is {state.st_size} bytes long; at most {most} are read")
        undo.pop_all()
    return open(number, "rb")


def read_bytes(path: str | Path, most: int, folder: str | Path | None = None) -> bytes:
    """Return the content of a file; arguments and errors are those of `open_regular`."""
    with open_regular(path, most, folder) as file:
        try:
            data = file.read(most + 1)
        except OSError as e:
            raise UnusableFile(_sentence(path, e)) from None
    if len(data) > most:  # it grew, or its system does not tell how long it is
        raise TooLong(f"{path} is longer than {most} bytes; no more are read")
    return data


def read_text(path: str | Path, most: int, folder: str | Path | None = None) -> str:
    """Return the content of a file in UTF-8; arguments and errors are those of `open_regular`."""
    try:
        return read_bytes(path, most, folder).decode("utf-8")
    except UnicodeDecodeError as e:
        raise UnusableFile(f"{path} is not UTF-8: {e.reason} at byte {e.start}") from None


def _sentence(path: str | Path, error: OSError) -> str:
    return f"{path} cannot be read: {error.strerror or error}"
