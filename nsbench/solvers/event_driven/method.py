"""The event-driven method: integrate between events, locate each one, choose the next mode.

Complementarity systems: a fixed set of active contacts on each arc (see _constrained). Filippov
systems: a fixed mode, sliding included (see _switching). Linear complementarity systems: a fixed
set of conducting rows (see _diodes). Errors are those of the integrator, at its tolerance: no order
in a step is lost at kinks, and no step is asked for.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from nsbench.case import Case
from nsbench.problem import LCS, Complementarity
from nsbench.solvers.base import Claims, Expect, Run, check_positive

METHODS = ("dop853", "rk45", "radau", "lsoda")
EXPECTS = (
    Expect(
        ("zeno",),
        "chatter",
        None,
        "no method that follows events can pass a time at which they accumulate",
    ),
    Expect(
        ("not_unique", "corner"),
        None,
        None,
        "the multilinear convention picks one of the velocities in a corner",
    ),
    Expect(
        ("not_unique",),
        "degenerate",
        None,
        "several motions continue: the method says so and stops",
    ),
)


@dataclass(frozen=True)
class EventDriven:
    """Smooth arcs between located events.

    method: the integrator (dop853, rk45, radau, lsoda). max_events, max_steps: budgets of one run.
    max_step: bound on a step (samples always end steps of the host). compiled: follow Filippov
    systems that can be traced by Taylor series, compiled, with `dop853` where those need help. tol:
    relative and absolute tolerance of the integrator; the absolute one in the unit of the case (see
    _units).
    """

    method: str = "dop853"
    max_events: int = 100_000
    max_steps: int = 1_000_000
    max_step: float = float("inf")
    compiled: bool = True

    accuracy: ClassVar[str] = "tol"
    default: ClassVar[float] = 1e-12
    claims: ClassVar[Claims] = Claims(exact=1e-10)
    expects: ClassVar[tuple[Expect, ...]] = EXPECTS

    def __post_init__(self):
        if self.method not in METHODS:
            raise ValueError(f"method is {self.method!r}; one of {', '.join(METHODS)}")
        for name in ("max_events", "max_steps"):
            if not (isinstance(getattr(self, name), int) and getattr(self, name) > 0):
                raise ValueError(f"{name} is {getattr(self, name)!r}; a positive integer is needed")
        if not self.max_step > 0:
            raise ValueError(f"max_step is {self.max_step!r}; a positive number is needed")

    def refuses(self, case: Case) -> str | None:
        if isinstance(case.problem, LCS):
            from nsbench.dynamics.lcs import inconsistent

            return inconsistent(case)
        if (
            isinstance(case.problem, Complementarity)
            and case.problem.constraints
            and case.start == "keep"
        ):
            return (
                "event_driven starts on the feasible set; this case keeps its start as it is "
                '(start="keep")'
            )
        return None

    def prepare(self, case: Case, accuracy: float) -> Run:
        tol = check_positive("tol", accuracy)
        if tol >= 0.1:
            raise ValueError(f"tol is {tol!r}; below 0.1 is needed")
        if isinstance(case.problem, Complementarity):
            from nsbench.solvers.event_driven.contacts import host_loop as method
        elif isinstance(case.problem, LCS):
            from nsbench.solvers.event_driven.lcs import loop as method
        else:
            from nsbench.solvers.event_driven.filippov import host_loop as method
        return method.prepare(case, self, tol)


SOLVER = EventDriven
