"""Result of a time loop of position-based dynamics: samples, impulse records and counters."""

from typing import NamedTuple

import numpy as np


class LoopResult(NamedTuple):
    """The result of one run.

    x, reaction (K, n): states and integrals of the reaction at the K recorded times, NaN behind the
    end. ids (R, 4), values (R,): records (sample, family, i, j) and the impulse since the sample
    before. projections: how many moved a state. code: a StepCode. reached: the time of the last
    step. rebuilds, contacts_peak: neighbour lists built, and the pairs of the longest one; both -1
    where the loop keeps no list.
    """

    x: np.ndarray
    reaction: np.ndarray
    ids: np.ndarray
    values: np.ndarray
    projections: int
    code: int
    reached: float
    rebuilds: int
    contacts_peak: int
