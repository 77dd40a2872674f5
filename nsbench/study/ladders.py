"""The accuracies of the standard suite: ladders of steps, tolerances and stiffnesses."""

from __future__ import annotations

import numpy as np

from nsbench.case import Case

POINTS = 19
OCTAVES = 6


def substeps_ladder(first: int, octaves: float = OCTAVES, points: int = POINTS) -> list[int]:
    """At least `points` step counts from `first` to 2^octaves times as many, at ratios that are not
    dyadic."""
    ratio = 2.0 ** (octaves / (points - 1)) * 1.003
    while True:
        out = [first]
        while out[-1] < first * 2**octaves:
            out.append(max(out[-1] + 1, round(out[-1] * ratio)))
        if len(out) >= points:
            return out
        ratio = 1.0 + 0.97 * (ratio - 1.0)


def ladder(case: Case, method) -> list[float]:
    """The accuracies of the standard suite for a case and a method."""
    if method.accuracy == "h":
        spacing = float(np.diff(case.t).min())
        # dyadic effects are avoided by the ratios; fewer steps than this per sample are not
        # asymptotic anywhere
        octaves = getattr(method, "octaves", OCTAVES)
        return [
            spacing / n
            for n in substeps_ladder(
                max(1, case.substeps), octaves, round(POINTS * octaves / OCTAVES)
            )
        ]
    values = getattr(method, "ladder", (method.default,))
    if method.accuracy == "k" and len(values) == 2:
        return [float(v) for v in np.geomspace(*values, POINTS)]
    return [float(v) for v in values]
