"""Tolerances and first step of a penalty run, in proportion to the scene's own sizes.

A scene in other units is then integrated by the same steps.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from nsbench.case import Case
from nsbench.dynamics.scaling.estimate import case_scale, switch_sizes
from nsbench.dynamics.scaling.scaled_case import scaled_case
from nsbench.problem import Affine, Filippov

if TYPE_CHECKING:
    from nsbench.solvers.penalty.method import Penalty

# of the time between samples and of that of a spring or layer: the control lets it grow
FIRST = 0.1

ROUNDED_UP = 0.5  # own sizes are the next powers of two


@dataclass(frozen=True)
class Limits:
    """Limits of the step control.

    rtol: relative. state (n,), impulse: absolute, of each coordinate and of impulses. has_reaction:
    do the quadratures end with the n sums of the reaction? steps: their largest number. layer:
    the time in which a layer of half-width 1 is crossed; of springs with k = 1 the time 1.
    """

    rtol: float
    state: np.ndarray
    impulse: float
    has_reaction: bool
    steps: int
    layer: float

    def absolute(self, quadratures: int) -> np.ndarray:
        """Return the absolute tolerances (n + quadratures,) of a state with its quadratures."""
        n = len(self.state)
        out = np.full(n + quadratures, self.impulse)
        out[:n] = self.state
        if self.has_reaction:
            out[-n:] = self.state
        return out

    def first_step(self, case: Case, k: float) -> float:
        """Return the length of the first step with stiffness k."""
        return FIRST * min(float(case.t[1] - case.t[0]), self.layer / k)


def limits_of(penalty: Penalty, case: Case, asked: float) -> Limits:
    """Return the limits of runs of a case; asked: k of the coarsest level of an extrapolation."""
    own = scaled_case(case)
    k = asked / penalty.accuracy_unit(case)
    atol = penalty.tolerance("atol", k)
    switches = isinstance(case.problem, Filippov)
    given = penalty.atol is not None
    return Limits(
        penalty.tolerance("rtol", k),
        np.full(case.n, atol) if given else atol * ROUNDED_UP * own.state,
        atol if given else atol * ROUNDED_UP * own.impulse,
        not switches,
        penalty.step_limit,
        own.time / smallest_switch(case) if switches else 1.0,
    )


def largest_gradient(case: Case) -> float:
    """Return the 2-norm of the largest gradient of an affine constraint; 1.0 if there is none.

    A force is k times a gap times a gradient, so a constraint in another unit has k in another.
    Gradients of other constraints change along the motion.
    """
    families = [c for c in case.problem.constraints if isinstance(c, Affine)]
    row = [np.repeat(np.arange(c.shape[0]), np.diff(c.indptr)) for c in families]
    squares = [np.bincount(i, c.data**2) for i, c in zip(row, families, strict=True)]
    norms = np.sqrt(np.concatenate(squares)) if squares else np.zeros(0)
    norms = norms[np.isfinite(norms) & (norms > 0.0)]
    return float(norms.max()) if len(norms) else 1.0


def smallest_switch(case: Case) -> float:
    """Return the size of the smallest switch of a Filippov case, in the user's unit; 1.0 if none
    has a size."""
    # not rounded to powers of two, as own units are: the same in all units but for rounding
    lengths = np.broadcast_to(case_scale(case).state, case.x0.shape)
    sizes = switch_sizes(case, lengths)
    return float(np.min(sizes[sizes > 0.0], initial=np.inf)) if np.any(sizes > 0.0) else 1.0
