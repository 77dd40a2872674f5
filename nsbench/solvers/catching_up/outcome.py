"""Record of a finished catching-up run: states, reactions, impulses and counters, of any loop."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Outcome(NamedTuple):
    """The result of one run.

    x, reaction (K, n): states and integrals of the reaction at the recorded times, NaN behind the
    end. ids (R, 4), values (R,): records (sample, family, i, j) and their impulses. work: counters,
    as in stats. worst, when: the largest KKT residual of a step and the time of that step. code:
    "ok", "nan", "infeasible" or "unsettled". reached: the time of the last step.
    """

    x: np.ndarray
    reaction: np.ndarray
    ids: np.ndarray
    values: np.ndarray
    work: dict
    worst: float
    when: float
    code: str
    reached: float
