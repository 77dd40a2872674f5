"""Switches and fields of a Filippov mode over interval Taylor series, for proofs of smoothness.

The pieces of a step on which an arc is certainly smooth are found from the functions that the arc
is made of (nsbench.solvers.event_driven.smooth.pieces): all switches, and the fields of both sides
of every surface that the mode slides on.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import product

import numpy as np

from nsbench.compilation.user_forms.draft_array import settled
from nsbench.dynamics.filippov.vector_field import FREE
from nsbench.problem import Filippov
from nsbench.dynamics.interval_taylor import SPACE


def interval_fields(problem: Filippov) -> Callable:
    """Return (t, x, p) -> list of the switches and of the 2^k fields of mode p (d,), over Jets.

    k: number of surfaces on which the mode slides.
    """
    field = problem.field(SPACE)
    switch = problem.switch(SPACE)

    def evaluate(t, x, p) -> list:
        s = np.where(p == FREE, 0, p).astype(float)
        on = np.flatnonzero(p == 0)
        values = [switch(t, x)]
        for signs in product((1.0, -1.0), repeat=on.size):
            s[on] = signs
            values.append(settled(field(t, x, s.copy())))  # f may fill one array again
        return values

    return evaluate
