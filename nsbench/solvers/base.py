"""The protocol of a solver, and what it claims.

A solver is a frozen dataclass whose fields are its options, with

    accuracy   the name of its accuracy parameter: "h", "tol", "k"
    default    its default value
    claims     the orders it claims
    refuses(case) -> sentence or None
    prepare(case, accuracy) -> Run    compile, allocate, factorise: untimed; only the Run is timed
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from nsbench.case import Case
from nsbench.solvers.common.time_grid import Grid, check_positive, grid, last_steps, sample
from nsbench.trajectory import Trajectory

__all__ = [
    "Claims",
    "Expect",
    "Grid",
    "Run",
    "Solver",
    "accuracy_unit",
    "check_positive",
    "default_accuracy",
    "grid",
    "last_steps",
    "sample",
]

Run = Callable[[], Trajectory]


@dataclass(frozen=True)
class Claims:
    """Orders that a method claims in its accuracy parameter: h of fixed steps, 1/k of a penalty.

    state, impulse: None where no order is claimed. exact: a bound on the state error relative to
    max(1, |x|), claimed instead of an order (event-driven). rounding: how many times the rounding
    of one addition per step h can appear in the result; errors below that are no errors of the
    method.
    """

    state: float | None = None
    impulse: float | None = None
    exact: float | None = None
    rounding: float = 1.0


@dataclass(frozen=True)
class Expect:
    """What a method should show on a class of cases; elsewhere its claims are expected.

    when: words of `Case.classes`, all of which the case has. state, impulse: an order, or a word:
    "exact" (rounding at every step, no order), "plateau", "diverges", "open" (no verdict can be
    expected), or the status that its runs should end with; None: nothing is said. The impulse's
    expectation holds for the reaction where that stands for it.
    why: the reason, with its source.
    """

    when: tuple[str, ...]
    state: float | str | None
    impulse: float | str | None
    why: str


class Solver(Protocol):
    """A method as the bench uses it.

    Optional: `expects`, a tuple of `Expect`, of which the first one that applies to a case counts;
    `checks`, a tuple of `nsbench.diagnostics.Check` of its own, applied to a run that ended well,
    before the general ones and outside of what is timed; `accuracy_unit(case)`, of which `default`
    and `ladder` are multiples where a number alone would mean another accuracy in every unit.
    """

    accuracy: str
    default: float
    claims: Claims

    def refuses(self, case: Case) -> str | None: ...

    def prepare(self, case: Case, accuracy: float) -> Run: ...


def default_accuracy(method: Solver, case: Case) -> float:
    """Return the value of its accuracy parameter that a method takes where none is asked for."""
    return method.default * accuracy_unit(method, case)


def accuracy_unit(method: Solver, case: Case) -> float:
    """Return the unit of a method's default and ladder on a case; 1.0 where it has none."""
    unit = getattr(method, "accuracy_unit", None)
    return 1.0 if unit is None else float(unit(case))
