"""Columns measured against a reference: errors, error bars, which multipliers, rounding floors.

Written by `nsbench.measure.errors`. Notation: x* and lambda* are the reference, t_i the sample
times, D = t_{i+1} - t_i, I the cumulative impulse (integral of lambda dt) of each contact, matched
by id (a contact that is absent has none), R the cumulative reaction (integral of sum lambda_k
grad g_k dt).
"""

from __future__ import annotations

from nsbench.columns.column import Column

ERRORS = (
    Column(
        "state_sup",
        "error",
        "number",
        "state",
        "largest |x - x*| in any coordinate over the sample times",
        "state",
        gate="near",
        floor="state_floor",
        scale="state_scale",
    ),
    Column(
        "state_T",
        "error",
        "number",
        "state",
        "largest |x - x*| in any coordinate at the end time T",
        "state at T",
        gate="near",
        floor="state_floor",
        scale="state_scale",
    ),
    Column(
        "set_distance",
        "error",
        "number",
        "state",
        "distance of the states to the set of all solutions (the case's `distance`), in the place "
        "of state_sup where there are many",
        "distance to the set of solutions",
        gate="near",
        scale="state_scale",
    ),
    Column(
        "impulse",
        "error",
        "number",
        "impulse",
        "largest |I - I*| of any contact over the sample times (of a Filippov system: of the "
        "integral of the weight theta, of a hybrid one of the time in a mode); also under chatter",
        "impulse",
        gate="near",
        floor="impulse_floor",
        scale="impulse_scale",
    ),
    Column(
        "reaction",
        "error",
        "number",
        "impulse",
        "largest |R - R*| in any coordinate over the sample times; R is unique even where "
        "multipliers are not",
        "reaction",
        gate="near",
        floor="reaction_floor",
        scale="impulse_scale",
    ),
    Column(
        "l1",
        "error",
        "number",
        "impulse",
        "sum over sample intervals and contacts of |I - I*| gained in the interval: the L1 "
        "distance of interval means",
        "impulse, L1",
        gate="near",
        floor="impulse_floor",
        scale="impulse_scale",
    ),
    Column(
        "settled",
        "error",
        "number",
        "multiplier",
        "largest difference of interval means of a multiplier outside windows of 2 sample "
        "spacings around the reference's events",
        "settled multiplier",
        gate="near",
        floor="impulse_floor",
        scale="impulse_scale",
    ),
    Column(
        "sup",
        "error",
        "number",
        "multiplier",
        "largest difference of interval means of a multiplier in any interval: a diagnostic, it "
        "has no order where multipliers jump",
        "multiplier, any interval",
        gate="near",
        floor="impulse_floor",
        scale="impulse_scale",
    ),
    Column(
        "lam_own",
        "error",
        "number",
        "multiplier",
        "largest error of single steps' multipliers away from events, at the method's own time in "
        "the step (lam_time)",
        "multiplier at its own time",
        gate="near",
        floor="lam_floor",
        scale="impulse_scale",
    ),
    Column(
        "lam_at_start",
        "error",
        "number",
        "multiplier",
        "as lam_own, against the exact multiplier at the start of the step",
        "multiplier at the start of the step",
        gate="near",
        floor="lam_floor",
        scale="impulse_scale",
    ),
    Column(
        "lam_at_mid",
        "error",
        "number",
        "multiplier",
        "as lam_own, against the exact multiplier at the middle of the step",
        "multiplier at the middle of the step",
        gate="near",
        floor="lam_floor",
        scale="impulse_scale",
    ),
    Column(
        "lam_at_end",
        "error",
        "number",
        "multiplier",
        "as lam_own, against the exact multiplier at the end of the step",
        "multiplier at the end of the step",
        gate="near",
        floor="lam_floor",
        scale="impulse_scale",
    ),
    Column(
        "lam_mean",
        "error",
        "number",
        "multiplier",
        "as lam_own, against the mean of the exact multiplier over the step",
        "multiplier, mean over the step",
        gate="near",
        floor="lam_floor",
        scale="impulse_scale",
    ),
    Column(
        "event_time",
        "error",
        "number",
        "time",
        "largest error of a located event, matched within its kind and contact",
        "event time",
        gate="near",
        floor="event_floor",
        scale="impulse_scale",
    ),
    Column(
        "events_missed",
        "error",
        "count",
        "1",
        "events of the reference that were not located",
        "events missed",
        gate="count",
    ),
    Column(
        "events_extra",
        "error",
        "count",
        "1",
        "located events that the reference does not have",
        "events too many",
        gate="count",
    ),
)
ERROR_BARS = (
    Column(
        "bound_state",
        "error bar",
        "number",
        "state",
        "bound of |x - x*| in the 2-norm, largest over the sample times, proven for convex "
        "constraints with flat faces",
        "bound of the state's error",
        floor="state_floor",
        scale="state_scale",
    ),
    Column(
        "bound_reaction",
        "error bar",
        "number",
        "impulse",
        "bound of |R - R*| in the 2-norm, as bound_state",
        "bound of the reaction's error",
        floor="reaction_floor",
        scale="impulse_scale",
    ),
    Column(
        "estimate_state",
        "error bar",
        "number",
        "state",
        "estimate of |x - x*| in the 2-norm, largest over the sample times, where there is no "
        "bound",
        "estimate of the state's error",
        floor="state_floor",
        scale="state_scale",
    ),
    Column(
        "estimate_reaction",
        "error bar",
        "number",
        "impulse",
        "estimate of |R - R*| in the 2-norm, as estimate_state",
        "estimate of the reaction's error",
        floor="reaction_floor",
        scale="impulse_scale",
    ),
    Column(
        "state_norm",
        "error bar",
        "number",
        "state",
        "largest |x - x*| in the 2-norm over the sample times: what error bars of the state are "
        "compared with, of runs that have some",
        "state, 2-norm",
        floor="state_floor",
        scale="state_scale",
    ),
    Column(
        "reaction_norm",
        "error bar",
        "number",
        "impulse",
        "largest |R - R*| in the 2-norm over the sample times",
        "reaction, 2-norm",
        floor="reaction_floor",
        scale="impulse_scale",
    ),
    Column(
        "estimate_impulse",
        "error bar",
        "number",
        "impulse",
        "error bar of the reaction over the least singular value of the active unit gradients: an "
        "estimate of |I - I*| in the 2-norm; infinite where multipliers are not unique",
        "estimate of the impulses' error",
        scale="impulse_scale",
    ),
    Column(
        "lam_variation",
        "error bar",
        "number",
        "multiplier",
        "sum over contacts and recorded times of the changes of mean multipliers: order one rests "
        "on its being bounded",
        "variation of the multipliers",
        scale="impulse_scale",
    ),
)
SELECTION = (
    Column(
        "selection",
        "selection",
        "number",
        "multiplier",
        "Euclidean distance of the multipliers to the least-norm one, where they are not unique: "
        "which one a method picks (self-stress), never an error",
        "selection",
        gate="near",
        scale="impulse_scale",
    ),
    Column(
        "polyhedron",
        "selection",
        "number",
        "multiplier",
        "Euclidean distance of the multipliers to the set of all that give the reaction",
        "distance to the set of multipliers",
        gate="near",
        scale="impulse_scale",
    ),
)
FLOORS = (
    Column("state_floor", "floor", "number", "state", "ten times the reference's error of x"),
    Column(
        "impulse_floor",
        "floor",
        "number",
        "impulse",
        "ten times the reference's error of I; of R where the multipliers are not unique",
    ),
    Column("reaction_floor", "floor", "number", "impulse", "ten times the reference's error of R"),
    Column("event_floor", "floor", "number", "time", "ten times the error of its event times"),
    Column(
        "lam_floor",
        "floor",
        "number",
        "multiplier",
        "ten times the error of the exact multiplier that single steps are compared with",
    ),
    Column(
        "state_scale",
        "floor",
        "number",
        "state",
        "largest |x*|, at least 1: what rounding of the state is relative to",
    ),
    Column(
        "impulse_scale",
        "floor",
        "number",
        "impulse",
        "largest |I*| or |R*|, at least 1: what rounding of the impulses is relative to",
    ),
)
REFERENCE = (
    Column(
        "reference",
        "reference",
        "word",
        "",
        "closed form, certified, stored or none",
    ),
    Column(
        "multipliers_unique",
        "reference",
        "flag",
        "",
        "have the active gradients full rank along the reference? Where not, impulse, l1, settled, "
        "sup and lam_* are missing: reaction, polyhedron and selection stand in their place",
    ),
    Column(
        "compared",
        "reference",
        "word",
        "",
        "impulse or reaction, whose error tells of the multipliers: reaction where they are not "
        "unique, or nearly not, so that the reference knows the impulses to 1e-8 of their size or "
        "worse and 1000 times worse than the reaction",
    ),
    Column(
        "below",
        "reference",
        "word",
        "",
        "names of the errors that lie below ten times what the reference's own error can make of "
        "them (summed over 2 k intervals for l1, divided by the shortest D for settled and sup)",
    ),
)
