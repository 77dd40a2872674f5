"""Detect that an equation is stiff, from the last two stages of explicit steps.

An equation is called stiff if it is STIFF_RATIO times faster than the solution in STIFF_STEPS steps
in a row and STIFF_REMAINING steps are still to come: then an implicit method is faster (Hairer &
Wanner 1996, section IV.2).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from nsbench.solvers.event_driven.smooth.integrators import EndStages

if TYPE_CHECKING:
    from scipy.integrate import OdeSolver

STIFF_RATIO = 20.0
STIFF_STEPS = 15
STIFF_REMAINING = 2000


class StiffnessDetector:
    """Detect that the equation, not the solution, bounds the steps of an arc up to t_end.

    Called after every step of an explicit Runge-Kutta method.
    """

    def __init__(self, t_end: float):
        self._t_end = t_end
        self._stiff_steps = 0

    def __call__(self, solver: OdeSolver, stages: EndStages, t: float, y: np.ndarray) -> bool:
        """Return whether the equation is stiff, after the step of `solver` from (t, y (n,)).

        Both speeds follow from the two stages at the end of the step.
        """
        h = solver.t - t
        K = solver.K
        inner = stages.inner
        end = stages.solution
        stage = y + h * (solver.A[inner, :inner] @ K[:inner])
        fast = np.linalg.norm(K[end] - K[inner]) / np.linalg.norm(solver.y - stage)
        slow = np.linalg.norm(K[end] - K[0]) / (
            h * max(np.linalg.norm(K[end]), np.linalg.norm(K[0]))
        )
        stiff = fast > STIFF_RATIO * slow and np.isfinite(fast)
        self._stiff_steps = self._stiff_steps + 1 if stiff else max(self._stiff_steps - 1, 0)
        remaining = self._t_end - solver.t
        return self._stiff_steps >= STIFF_STEPS and remaining > STIFF_REMAINING * h
