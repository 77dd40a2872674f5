"""Richardson extrapolation in the step of PBD or catching-up.

Runs with h, h/2 (and h/4) are combined at the sample times.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nsbench.case import Case
from nsbench.solvers.base import Claims, Expect, Run, Solver, grid
from nsbench.solvers.common.extrapolation import combined, weights
from nsbench.trajectory import Trajectory

METHODS = ("pbd", "catching_up")
SETTLING = Expect(
    ("constant_force",),
    "open",
    "open",
    "steps along constant forces and gradients leave no error of size h "
    "but a sweep's that settles, which has no expansion in h",
)
EXPECTS = (
    Expect(
        ("exact_at_grid",),
        "exact",
        "exact",
        "every step of Euler is exact for a drift that is constant in each mode",
    ),
    Expect(
        ("infeasible_start",),
        None,
        None,
        "what a method makes of an infeasible start is its meaning, not its error",
    ),
)
STANDARD = ("richardson",)


@dataclass(frozen=True)
class Richardson:
    """2 x(h/2) - x(h) of "pbd" or "catching_up" at every sample, for states, impulses by contact
    and reaction alike;
    levels = 3: (x(h) - 6 x(h/2) + 8 x(h/4)) / 3.

    Between events both methods have an error C(t) h + O(h^2). A step in which a contact closes or
    opens adds an error of size h^2 that depends on where in the step the event lies: so two levels
    claim order 2, and three do too, with a smaller constant; order 3 is left to runs without
    events. Within some steps of an event, while a sweep still settles, errors of size h depend on
    it too. The result is feasible only up to its error; where a state passed an event in one run
    and not in the other, up to h. Steps must end at the samples.
    Source: Richardson 1911; expansion of one-step methods: Gragg 1965, Hairer, Norsett & Wanner I,
    II.8.
    """

    method: str = "pbd"
    levels: int = 2

    accuracy = "h"
    default = 1e-2

    @property
    def claims(self) -> Claims:
        """Return the claims: order 2, and how much of the rounding errors the weights amplify.

        A run with h/2^j makes 2^j additions per h, and its weight multiplies what they leave.
        """
        return Claims(
            state=2.0,
            impulse=2.0,
            rounding=sum(abs(float(w)) * 2**j for j, w in enumerate(weights(self.levels - 1))),
        )

    @property
    def expects(self) -> tuple[Expect, ...]:
        """Return the expectations of the method that is extrapolated, as far as they carry over."""
        return (*EXPECTS, SETTLING) if self.method == "pbd" else self.base.expects

    def __post_init__(self):
        if self.method not in METHODS:
            raise ValueError(f"method is {self.method!r}; one of {', '.join(METHODS)}")
        if self.levels not in (2, 3) or isinstance(self.levels, bool):
            raise ValueError(f"levels is {self.levels!r}; 2 or 3")

    @property
    def base(self) -> Solver:
        """Return the method that is extrapolated."""
        from nsbench.solvers.registry import get  # which imports this file

        return get(self.method)

    def refuses(self, case: Case) -> str | None:
        """Explain why the extrapolated method does not take the case; None if it does."""
        return self.base.refuses(case)

    def prepare(self, case: Case, h: float) -> Run:
        """Prepare the runs with h, h/2 (and h/4); return the run that combines them."""
        from nsbench.solvers.registry import refused

        grids = [grid(case.t, h)]
        h = grids[0].h
        grids += [grid(case.t, h / 2**level) for level in range(1, self.levels)]
        first = grids[0]
        if not (first.aligned and np.array_equal(first.t, case.t)):
            why = (
                f"Steps of {h:g} do not end at the samples, {np.diff(case.t).min():g} apart: "
                f"there is nothing to extrapolate."
            )
            return lambda: refused(case, why)
        if any(
            not np.array_equal(g.substeps, first.substeps * 2**level)
            for level, g in enumerate(grids)
        ):
            why = (
                "The samples are not equally spaced, and steps that end at them cannot be halved "
                "everywhere: there is "
                "nothing to extrapolate."
            )
            return lambda: refused(case, why)
        runs = [self.base.prepare(case, h / 2**level) for level in range(self.levels)]

        def finer() -> Trajectory:
            return self.base.prepare(case, h / 2**self.levels)()

        return lambda: combined([run() for run in runs], h, case, finer)


SOLVER = Richardson
