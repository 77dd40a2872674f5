"""How seconds and counted work grow from runs that were made to finer ones that were not.

A run of fixed steps has a part that does not depend on their number, values = a + b/h. A power law,
fitted where a is seen, carries that part on over decades: 27 times too few seconds for PBD on a
pulled chain, four decades below its finest step. The fineness of a run is 1/h, 1/tol or k.
"""

from __future__ import annotations

import math

import numpy as np

# powers of the fineness where one run alone is known: steps, orders of five and two (an implicit
# method takes longer steps where stiffness k makes the system stiff)
TYPICAL_POWER = {"h": 1.0, "tol": 0.2, "k": 0.5}
# a method whose steps cost more as they get shorter does not reach it
STEEPEST_POWER = 2.0


def grow(accuracy: str, fineness: np.ndarray, values: np.ndarray, to: float) -> float:
    """Carry values (k,) of runs of a fineness (k,), rising, to the fineness `to` beyond them.

    Steps take equal parts, unless values grow faster than their number; tolerances and stiffness
    are carried by a power. accuracy: "h", "tol" or "k".
    """
    known = np.isfinite(values) & (values > 0.0)
    if not known.any():
        return math.nan
    fineness = fineness[known]
    values = values[known]
    power = median_slope(np.log(fineness), np.log(values))
    if np.isnan(power):
        return float(values[-1] * (to / fineness[-1]) ** TYPICAL_POWER[accuracy])
    if accuracy == "h" and power <= TYPICAL_POWER["h"]:
        # values do not fall with finer steps: that is noise of quick runs
        each = max(median_slope(fineness, values), 0.0)
        return float(np.median(values - each * fineness) + each * to)
    power = min(max(power, 0.0), STEEPEST_POWER)
    return float(np.median(values / fineness**power) * to**power)


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
