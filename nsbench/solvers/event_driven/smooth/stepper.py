"""Call a stepper of scipy.integrate: count the calls of its function, and take one step."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from scipy.integrate import OdeSolver


class CountedFunction:
    """Right-hand side with a count of its calls."""

    def __init__(self, rhs: Callable):
        self.rhs = rhs
        self.calls = 0

    def __call__(self, t: float, y: np.ndarray) -> np.ndarray:
        """Evaluate the right-hand side."""
        self.calls += 1
        return self.rhs(t, y)


def take_step(solver: OdeSolver) -> str | None:
    """Take one step of a SciPy stepper; return None, or why it failed.

    Its linear algebra raises on values that are not finite.
    """
    try:
        why = solver.step()
    except (ValueError, np.linalg.LinAlgError) as e:
        return str(e)
    return (why or "failed") if solver.status == "failed" else None
