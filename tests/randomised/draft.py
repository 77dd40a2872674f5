"""A scene on its way to a case file.

It is drawn in units of its own and written in `scale` times them, around `offset`: 1e8, 1e-8, or
shifted by 1e8.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from randomised.choices import Choices
from randomised.grammar import expression


@dataclass
class Draft:
    """What a scene is written from. x0 in its own units; parts: definitions; problem: an
    expression; notes: what it is."""

    c: Choices
    what: str
    t0: float
    scale: float = 1.0
    offset: float = 0.0
    parts: list[str] = field(default_factory=list)
    names: set[str] = field(default_factory=lambda: {"Case"})
    notes: list[str] = field(default_factory=list)

    def function(self, name: str, args: str, rows: list[str], size: str = "") -> str:
        """A factory of an array of expressions; size: what to multiply the array by."""
        shift = (
            f"        x = (x - {self.offset!r}) / {self.scale!r}\n"
            if "x" in args and self.framed
            else ""
        )
        self.parts.append(
            f"def {name}(xp):\n    def f({args}):\n{shift}        return "
            f"{size}xp.array([{', '.join(rows)}])\n"
            "    return f\n"
        )
        return name

    @property
    def framed(self) -> bool:
        return (self.scale, self.offset) != (1.0, 0.0)

    @property
    def times(self) -> str:
        return f"{self.scale!r} * " if self.scale != 1.0 else ""

    def note(self, word: str):
        self.notes.append(word)

    def drift(self, name, n, wild, extra=()):
        rows = [expression(self.c, n, self.t0, wild) for _ in range(n)]
        rows = [f"{a} + {b}" if b else a for a, b in zip(rows, extra or [""] * n, strict=True)]
        return self.function(name, "t, x", rows, self.times)


def array(v) -> str:
    return f"np.array({np.asarray(v, float).tolist()!r})"
