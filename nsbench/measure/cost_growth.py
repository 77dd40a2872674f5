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

    Values do not fall with finer steps: that is noise of quick runs. Where b is not known, they
    grow like 1/h.
    """
    known = np.isfinite(values)
    steps = 1.0 / h[known]
    one = median_slope(steps, values[known])
    if np.isnan(one):
        return float(values[-1] * h[-1] / to)
    one = max(one, 0.0)
    return float(np.median(values[known] - one * steps) + one / to)


def grow_by_power(h: np.ndarray, values: np.ndarray, to: float) -> float:
    """Carry values (k,) ~ h^p to `to`; p is not above 0, and -1 where it is not known."""
    use = np.isfinite(values) & (values > 0.0)
    x = np.log(h[use])
    y = np.log(values[use])
    p = median_slope(x, y)
    if np.isnan(p):
        return float(values[-1] * h[-1] / to)
    p = min(0.0, p)
    return float(np.exp(np.median(y - p * x) + p * np.log(to)))


def median_slope(x: np.ndarray, y: np.ndarray) -> float:
    """Return the median slope of all pairs of points (k,), which one slow timing does not turn; NaN
    for fewer than two places x.

    Source: Sen, Estimates of the regression coefficient based on Kendall's tau, J. Amer. Statist.
    Assoc. 63 (1968).
    """
    first, second = np.triu_indices(x.size, 1)
    run = x[second] - x[first]
    apart = np.abs(run) > 1e-12 * np.abs(x[first])
    if not apart.any():
        return math.nan
    return float(np.median((y[second] - y[first])[apart] / run[apart]))
