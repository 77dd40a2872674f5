"""How seconds and counted work grow from runs that were made to steps that were not.

A run of fixed steps has a part that does not depend on their number, values = a + b/h. A power law,
fitted where a is seen, carries that part on over decades: 27 times too few seconds for PBD on a
pulled chain, four decades below its finest step.
"""

from __future__ import annotations

import math

import numpy as np


def grow_by_steps(h: np.ndarray, values: np.ndarray, to: float) -> float:
    """Carry values (k,) = a + b/h of steps h (k,), coarsest first, from the last one to `to`.

    b is fitted by least squares to 1/h, which weighs the finest steps most. Values do not fall with
    finer steps: that is noise of quick runs. Where b is not known, they grow like 1/h.
    """
    known = np.isfinite(values)
    steps = 1.0 / h[known]
    if steps.size < 2 or np.ptp(steps) == 0.0:
        return float(values[-1] * h[-1] / to)
    one = float(np.polyfit(steps, values[known], 1)[0])
    return float(values[-1] + max(one, 0.0) * (1.0 / to - 1.0 / h[-1]))


def grow_by_power(h: np.ndarray, values: np.ndarray, to: float) -> float:
    """Carry values (k,) ~ h^p from the last of h (k,) to `to`, with p fitted, at most 0."""
    return float(values[-1] * (to / h[-1]) ** min(0.0, exponent(h, values)))


def exponent(h: np.ndarray, values: np.ndarray) -> float:
    """Return p of values ~ h^p, fitted to steps h (k,); -1.0 where it is not known."""
    use = np.isfinite(values) & (values > 0.0)
    x = np.log(h[use])
    if x.size < 2 or math.isclose(np.ptp(x), 0.0):
        return -1.0
    return float(np.polyfit(x, np.log(values[use]), 1)[0])
