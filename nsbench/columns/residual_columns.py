"""Columns that the bench computes from a trajectory alone: residuals, which need no reference.

Their values are computed in `nsbench.measure.residuals`, under the names that stand here.
"""

from __future__ import annotations

from nsbench.columns.column import Column

RESIDUALS = (
    Column(
        "feasibility",
        "residual",
        "number",
        "gap",
        "largest violation max(0, -g) over constraints and sample times; of a linear "
        "complementarity system: of the means of w over sample intervals, beyond what their "
        "quadrature may be wrong by (O(h) for multipliers that belong to the end of a step)",
        "violation",
        gate="near",
        scale="state_scale",
    ),
    Column(
        "sign",
        "residual",
        "number",
        "multiplier",
        "smallest interval mean of a multiplier; of a Filippov system: of theta and 1 - theta",
        gate="min",
        scale="impulse_scale",
    ),
    Column(
        "complementarity",
        "residual",
        "number",
        "gap x multiplier",
        "largest product of a gap that stays open over an interval and its mean multiplier",
        gate="near",
        scale="impulse_scale",
    ),
    Column(
        "residual",
        "residual",
        "number",
        "state / time",
        "largest defect of the equation over an interval, per unit of time, beyond what the "
        "quadrature may be wrong by; of a Filippov system: distance of the velocity to the "
        "convex hull of the fields; of a hybrid one: in intervals without a transition",
        "equation residual",
        gate="near",
        scale="impulse_scale",
    ),
)
