"""The Scale record: a case's unit of time and sizes of coordinates, stated by its author or found.

All tolerances are relative to it; nsbench.dynamics.scaling.estimate finds it where the case states
none, and nsbench.dynamics.scaling.scaled_case applies it.

Methods and checks work on a case in its own units (nsbench.dynamics.scaling), so that the constants
in them mean the same in every unit. Sentences about such a run speak in the user's units: while
`in_units` lasts, `time_text` and its like convert.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from typing import Any

import numpy as np

from nsbench.input_errors import named_fields
from nsbench.problem import float_array


@named_fields
@dataclass(frozen=True, eq=False)
class Scale:
    """Units of a case: its time T and the sizes S of its coordinates.

    time: in which the motion goes about its own size. state: a number, or (n,), one size for each
    coordinate; of a Complementarity problem, whose gradients need one length, a number. Raises
    TypeError or ValueError for what is not positive and finite.
    """

    time: float
    state: Any

    def __post_init__(self):
        for name, value in (
            ("time", float(float_array("scale.time", self.time, 0))),
            ("state", float_array("scale.state", self.state)),
        ):
            if np.any(np.less_equal(value, 0.0)):
                raise ValueError(f"scale.{name} is {value}; positive numbers are needed")
            object.__setattr__(self, name, value)

    @property
    def length(self) -> float:
        """Return the largest of the sizes."""
        return float(np.max(self.state))


_units: ContextVar[tuple[float, float, float]] = ContextVar("units", default=(0.0, 1.0, 1.0))


@contextmanager
def in_units(origin: float, time: float, length: float) -> Iterator[None]:
    """Let sentences made within speak of times origin + time t, and of sizes length v."""
    token = _units.set((origin, time, length))
    try:
        yield
    finally:
        _units.reset(token)


def time_text(t: float, digits: int = 9) -> str:
    """Return the instant t of a run in words, in the units of the user."""
    origin, time, _ = _units.get()
    return f"{origin + time * t:.{digits}g}"


def span_text(t: float, digits: int = 3) -> str:
    """Return the length t of a time in words, in the units of the user."""
    return f"{_units.get()[1] * t:.{digits}g}"


def size_text(v: float, digits: int = 3) -> str:
    """Return the size v of a state in words, in the units of the user."""
    return f"{_units.get()[2] * v:.{digits}g}"
