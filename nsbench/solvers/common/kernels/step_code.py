"""Codes with which time loops end, and the checks of a state x (n,) that give them.

`state_code` and `all_finite` are called once a step.
"""

import enum

import numpy as np

from nsbench.compilation.decorators import inner_kernel, njit

LARGEST_STATE = 1e150  # |x_i| beyond which squares may overflow


class StepCode(enum.IntEnum):
    """How a time loop ended; solvers.common.loop_status.status_of says it in a sentence."""

    OK = 0
    NAN = 1  # a state, or what it is computed from, is not a number
    BLOWN = 2  # a state exceeds LARGEST_STATE
    TIED = 3  # coincident centres: a contact had no normal
    INFEASIBLE = 4  # the constraints or the complementarity problem of a step have no solution
    UNSOLVED = 5  # no solution of an implicit step was found among the modes tried
    NEWTON_LIMIT = 6  # Newton's method did not converge
    JUMP = 7  # the state would have to jump
    LIST_OVERFLOW = 8  # the candidate lists outgrow their limit


@inner_kernel
def state_code(x: np.ndarray) -> StepCode:
    """Return StepCode.NAN if x (n,) holds a NaN, BLOWN if an entry exceeds 1e150, else OK."""
    for v in x:
        if v != v:
            return StepCode.NAN
    for v in x:
        if abs(v) > LARGEST_STATE:
            return StepCode.BLOWN
    return StepCode.OK


@njit(cache=True)
def all_finite(x: np.ndarray) -> bool:
    """Return whether every entry of x (n,) is below 1e150, so that squares are finite too."""
    for v in x:
        if not abs(v) < LARGEST_STATE:
            return False
    return True
