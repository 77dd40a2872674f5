"""Solve a case by the event-driven method: integrate between events, locate each, choose a mode.

Complementarity systems: a fixed set of active contacts on each arc (see contacts). Filippov
systems: a fixed mode, sliding included (see filippov). Linear complementarity systems: a fixed set
of rows with w = 0 (see lcs). Hybrid systems: one of their modes (see hybrid). Errors are those of
the integrator at its tolerance: no order in a step is lost at kinks, and there is no fixed step.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from nsbench.case import Case
from nsbench.diagnostics.base import Check
from nsbench.problem import LCS, Complementarity, Hybrid
from nsbench.solvers.base import Claims, Expect, Run, check_positive
from nsbench.solvers.event_driven.amplified_error import CHECKS, CLAIM
from nsbench.solvers.event_driven.smooth.integrators import INTEGRATORS

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
    """Event-driven method: smooth arcs between located events.

    method: the integrator, a name of INTEGRATORS. max_events, max_steps: limits of one run.
    max_step: bound on a step (in Python, steps also end at the samples). compiled: integrate
    Filippov systems and contacts that can be traced by compiled Taylor series, with `dop853` where
    those need help. tol: relative and absolute tolerance of the integrator; the absolute one in
    characteristic lengths of the case.
    """

    method: str = "dop853"
    max_events: int = 100_000
    max_steps: int = 1_000_000
    max_step: float = float("inf")
    compiled: bool = True

    accuracy: ClassVar[str] = "tol"
    default: ClassVar[float] = 1e-12
    scaled: ClassVar[bool] = True
    has_tolerance_pair: ClassVar[bool] = True
    claims: ClassVar[Claims] = Claims(exact=CLAIM)
    checks: ClassVar[tuple[Check, ...]] = CHECKS
    expects: ClassVar[tuple[Expect, ...]] = EXPECTS

    def __post_init__(self):
        if self.method not in INTEGRATORS:
            raise ValueError(f"method is {self.method!r}; one of {', '.join(INTEGRATORS)}")
        for name in ("max_events", "max_steps"):
            if not (isinstance(getattr(self, name), int) and getattr(self, name) > 0):
                raise ValueError(f"{name} is {getattr(self, name)!r}; a positive integer is needed")
        if not self.max_step > 0:
            raise ValueError(f"max_step is {self.max_step!r}; a positive number is needed")

    def refuses(self, case: Case) -> str | None:
        """Return why the method cannot run the case, or None."""
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
        """Prepare a run with tolerance `accuracy`. Raises ValueError for 0.1 and more."""
        tol = check_positive("tol", accuracy)
        if tol >= 0.1:
            raise ValueError(f"tol is {tol!r}; below 0.1 is needed")
        if isinstance(case.problem, Complementarity):
            from nsbench.solvers.event_driven.contacts.preparation import prepare
        elif isinstance(case.problem, LCS):
            from nsbench.solvers.event_driven.lcs.loop import prepare
        elif isinstance(case.problem, Hybrid):
            from nsbench.solvers.event_driven.hybrid.loop import prepare
        else:
            from nsbench.solvers.event_driven.filippov.host_loop import prepare
        return prepare(case, self, tol)


SOLVER = EventDriven
