"""Layers around surfaces, of penalties and of tolerances, where a switch is flat: there they are thicker than they say."""
from __future__ import annotations

import numpy as np

from nsbench.case import Case
from nsbench.solvers._sliding import Motion

THICK = 0.1             # of the largest slope of a switch: there its layer is ten times as thick, and thicker as it is refined


def flat_layer(case: Case, width: float, X: np.ndarray) -> str:
    """Where a run of a Filippov system is within `width` of a surface whose switch is flat there, so that what is hidden
    below `width` is no small length; "" if it is nowhere."""
    motion = Motion(case.problem, float(case.t[0]), X[0].copy())
    rows = np.arange(motion.d)
    with np.errstate(all="ignore"):
        steep = np.array([np.linalg.norm(motion.gradients(float(t), x, rows), axis=1) for t, x in zip(case.t, X, strict=True)])
        inside = np.array([np.abs(motion.switch(float(t), x)) < width for t, x in zip(case.t, X, strict=True)])
    found = np.argwhere(inside & (steep < THICK * steep.max(axis=0)))
    if not len(found):
        return ""
    at, row = found[0]
    return (f"At t = {case.t[at]:.6g} the state is in the layer of surface {row} where its switch is flat (a slope of "
            f"{steep[at, row]:.2g}, elsewhere {steep[:, row].max():.2g})")
