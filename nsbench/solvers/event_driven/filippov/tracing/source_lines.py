"""Find the line of the user's file that is being traced, or that failed to be."""

from __future__ import annotations

import sys
from typing import NamedTuple

import numpy as np

from nsbench.input_errors import PACKAGE

CASES = f"{PACKAGE}/cases/"
INNER = (f"{PACKAGE}/", f"{np.__path__[0]}/", "<__array_function__")


class Place(NamedTuple):
    """A line of a file that is being run."""

    file: str
    line: int

    @property
    def inner(self) -> bool:
        """Is it one of numpy or of nsbench itself?"""
        return self.file.startswith(INNER) and not self.file.startswith(CASES)

    def __str__(self):
        return f"line {self.line} of {self.file.rpartition('/')[2]}"


def user_line(places: list[Place]) -> str:
    """Name the line of the user's file among the places of a stack, the outermost first.

    It is the innermost line of the file that nsbench called; "" if it called none.
    """
    calls = [k for k, place in enumerate(places) if place.inner]
    own = next((p for p in places if not p.inner), None) if not calls else None
    for before, after in zip(places, places[1:], strict=False):
        own = after if before.inner and not after.inner else own
    return "" if own is None else str([p for p in places if p.file == own.file][-1])


def calling_line() -> str:
    """Name the line of the user's file that is being traced, "" outside of one."""
    places = []
    frame = sys._getframe(1)
    while frame is not None:
        places.append(Place(frame.f_code.co_filename, frame.f_lineno))
        frame = frame.f_back
    return user_line(places[::-1])


def failing_places(error: Exception) -> list[Place]:
    """Return the places of the stack in which an error was raised, the outermost first."""
    places = []
    traceback = error.__traceback__
    while traceback is not None:
        places.append(Place(traceback.tb_frame.f_code.co_filename, traceback.tb_lineno))
        traceback = traceback.tb_next
    return places
