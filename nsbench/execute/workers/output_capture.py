"""What a worker's runs print, by Python or by C: taken up as it comes, a bounded part of it kept
for each run."""

from __future__ import annotations

import contextlib
import os
import secrets
from collections.abc import Iterator
from dataclasses import dataclass, field

PIPE = (
    1 << 20
)  # bytes: more than a pipe holds; who finds as much at once has met a run that does not stop
KEPT = 32 << 10  # bytes of the beginning of what a run prints, and as many of its end
NOBODY = -1  # what is printed outside the runs, or by one that is made again for its times


def mark(word: bytes, i: int) -> bytes:
    """Written between what two runs print: from here on it is run i that prints. (The worker is
    ahead of what its parent has heard: when a row comes the next run may have printed already.)"""
    return b"\0%s%9d\0" % (word, i)


@dataclass
class _Kept:
    """The beginning and the end of what one run has printed, and how long it was."""

    head: bytearray = field(default_factory=bytearray)
    tail: bytearray = field(default_factory=bytearray)
    size: int = 0

    def add(self, data: bytes) -> None:
        room = KEPT - len(self.head)
        self.size += len(data)
        self.head += data[:room]
        if room < len(data):
            self.tail = (self.tail + data[room:])[-KEPT:]

    def __bytes__(self) -> bytes:
        left = self.size - len(self.head) - len(self.tail)
        return (
            bytes(self.head)
            + (b"\n[%d bytes left out]\n" % left if left else b"")
            + bytes(self.tail)
        )


class OutputCapture:
    """The parent's end of a pipe into which a worker's descriptors 1 and 2 lead; the worker never
    waits for long, since it is emptied with every look of the parent. word: what no run can print
    by chance, see `mark`."""

    def __init__(self, connection, word: bytes = b""):
        self.connection = connection
        self.open = True
        self.word = word or secrets.token_hex(8).encode()
        os.set_blocking(connection.fileno(), False)
        self._rest = b""
        self._current = NOBODY
        self._kept = {}

    def fileno(self) -> int:
        return self.connection.fileno()

    def drain(self) -> None:
        """Take up all that was printed before this call."""
        size = 0
        for data in self._chunks():
            self._sort(data)
            size += len(data)
            if size >= PIPE:
                return

    def _chunks(self) -> Iterator[bytes]:
        with contextlib.suppress(BlockingIOError):
            while self.open:
                data = os.read(self.connection.fileno(), 1 << 16)
                self.open = bool(data)  # nothing: nobody holds the other end any more
                if data:
                    yield data

    def _sort(self, data: bytes) -> None:
        """To each run what is its own; half a mark waits for its other half."""
        data = self._rest + data
        begin = b"\0" + self.word
        length = len(mark(self.word, 0))
        while (k := data.find(begin)) >= 0 and len(data) >= k + length:
            self._add(data[:k])
            self._current = int(data[k + len(begin) : k + length - 1])
            data = data[k + length :]
        k = data.rfind(b"\0")
        k = (
            k
            if k >= 0 and (data[k:].startswith(begin) or begin.startswith(data[k:]))
            else len(data)
        )
        self._add(data[:k])
        self._rest = data[k:]

    def _add(self, data: bytes) -> None:
        if data:
            self._kept.setdefault(self._current, _Kept()).add(data)

    def take(self, i: int) -> bytes:
        """What run i has printed so far; in the middle of much, a line says how much was left
        out."""
        self.drain()
        return bytes(self._kept.pop(i, b""))

    def close(self) -> None:
        self.open = False
        self.connection.close()
