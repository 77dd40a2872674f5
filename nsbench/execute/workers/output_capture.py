"""Capture of what the runs of a worker print, from Python or from C; a bounded part is stored.

The worker's descriptors 1 and 2 lead into a pipe that the parent empties. Between the output of two
runs the worker writes a mark: zero byte, a secret word, the index of the run, zero byte. (The
worker is ahead of the messages that its parent has received: when a row arrives, the next run may
have printed already.)
"""

from __future__ import annotations

import contextlib
import os
import secrets
from collections.abc import Iterator
from dataclasses import dataclass, field

# bytes taken up at once: more than a pipe holds, so whoever finds as much has met endless output
MAX_DRAINED = 1 << 20
CHUNK = 1 << 16  # bytes of one read
STORED = 32 << 10  # bytes of the beginning of what a run prints, and as many of its end
NO_RUN = -1  # index of what is printed outside the runs, or by a repetition


def mark(word: bytes, i: int) -> bytes:
    """Build the mark after which run i prints."""
    return b"\0%s%9d\0" % (word, i)


@dataclass
class _BoundedText:
    """The beginning and the end of what one run has printed, and the length of all of it."""

    head: bytearray = field(default_factory=bytearray)
    tail: bytearray = field(default_factory=bytearray)
    size: int = 0

    def add(self, data: bytes) -> None:
        free = STORED - len(self.head)
        self.size += len(data)
        self.head += data[:free]
        if free < len(data):
            self.tail = (self.tail + data[free:])[-STORED:]

    def __bytes__(self) -> bytes:
        missing = self.size - len(self.head) - len(self.tail)
        note = b"\n[%d bytes left out]\n" % missing if missing else b""
        return bytes(self.head) + note + bytes(self.tail)


class OutputCapture:
    """The parent's end of the pipe into which a worker prints.

    connection: has the descriptor as fileno(); word: what no run can print by chance, see `mark`.
    The worker never waits for long, since the pipe is emptied whenever the parent checks its
    workers.
    """

    def __init__(self, connection, word: bytes = b""):
        self.connection = connection
        self.open = True
        self.word = word or secrets.token_hex(8).encode()
        os.set_blocking(connection.fileno(), False)
        self._unsorted = b""  # the beginning of a mark whose end has not arrived
        self._run = NO_RUN  # the run that prints
        self._texts: dict[int, _BoundedText] = {}

    def fileno(self) -> int:
        """Descriptor of the pipe, so that it can be waited for."""
        return self.connection.fileno()

    def drain(self) -> None:
        """Take up all that was printed before this call, at most MAX_DRAINED bytes."""
        size = 0
        for data in self._chunks():
            self._sort(data)
            size += len(data)
            if size >= MAX_DRAINED:
                return

    def _chunks(self) -> Iterator[bytes]:
        with contextlib.suppress(BlockingIOError):
            while self.open:
                data = os.read(self.connection.fileno(), CHUNK)
                self.open = bool(data)  # no data: nobody has the other end open any more
                if data:
                    yield data

    def _sort(self, data: bytes) -> None:
        """Give each run what is its own; half a mark waits for its other half."""
        data = self._unsorted + data
        begin = b"\0" + self.word
        length = len(mark(self.word, 0))
        while (k := data.find(begin)) >= 0 and len(data) >= k + length:
            self._add(data[:k])
            self._run = int(data[k + len(begin) : k + length - 1])
            data = data[k + length :]
        end = data.rfind(b"\0")
        is_half_mark = end >= 0 and (data[end:].startswith(begin) or begin.startswith(data[end:]))
        if not is_half_mark:
            end = len(data)
        self._add(data[:end])
        self._unsorted = data[end:]

    def _add(self, data: bytes) -> None:
        if data:
            self._texts.setdefault(self._run, _BoundedText()).add(data)

    def take(self, i: int) -> bytes:
        """Take what run i has printed so far; a line says how much was left out of a long text."""
        self.drain()
        return bytes(self._texts.pop(i, b""))

    def close(self) -> None:
        """Close the parent's end."""
        self.open = False
        self.connection.close()
