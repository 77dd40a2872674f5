"""Columns that tell what was run, how it ended, what it counted and how long it took.

Written by `nsbench.study` (what was run, status), by the methods (`stats` of a Trajectory: counted
work), by `nsbench.measure.clock` (seconds) and by the workers (warnings, limit, shared, session).
"""

from __future__ import annotations

from nsbench.columns.column import Column

RUN = (
    Column("case", "run", "word", "", "case with its parameters"),
    Column("solver", "run", "word", "", "method with its options"),
    Column("accuracy", "run", "word", "", "name of the accuracy parameter: h, tol or k"),
    Column("asked", "run", "number", "h, tol or k", "accuracy that was asked for"),
    Column(
        "h",
        "run",
        "number",
        "time",
        "longest step taken; 1 / k of a penalty; the tolerance of a method that controls its error",
        owner="solver",
    ),
    Column(
        "start",
        "run",
        "word",
        "",
        "what the case does with a start outside its constraints: feasible (an error), projected "
        "or kept",
    ),
    Column(
        "lam_time",
        "run",
        "word",
        "",
        "time in its step to which a multiplier of the method belongs: start, midpoint or end; "
        "mean: it is an average",
    ),
    Column(
        "claim_norm",
        "run",
        "word",
        "",
        "norm of an error that the method claims: coordinate: each one over its own size; length: "
        "any coordinate over the one own length of a gradient system; empty: it claims an order",
    ),
)
ENDING = (
    Column("status", "ending", "word", "", "how the run ended, one word of a closed list"),
    Column("why", "ending", "word", "", "sentence behind a status other than ok"),
    Column("check", "ending", "word", "", "name of the check that fired; empty: none did"),
    Column("warnings", "ending", "count", "1", "Python warnings that were raised during the run"),
    Column("limit", "ending", "number", "s", "limit that a timeout passed"),
)
WORK = (
    Column(
        "steps", "work", "count", "1", "accepted time steps", "steps", gate="count", owner="solver"
    ),
    Column(
        "drift_calls",
        "work",
        "count",
        "1",
        "evaluations of the drift",
        "drift calls",
        gate="count",
        owner="solver",
    ),
    Column(
        "projections",
        "work",
        "count",
        "1",
        "projections on one constraint that moved something",
        gate="count",
        owner="solver",
    ),
    Column(
        "qp_solves",
        "work",
        "count",
        "1",
        "quadratic programs or linear complementarity problems solved",
        "QP solves",
        gate="count",
        owner="solver",
    ),
    Column(
        "inner_iterations",
        "work",
        "count",
        "1",
        "iterations of the QP, complementarity or Newton solvers within the steps",
        "inner iterations",
        gate="count",
        owner="solver",
    ),
    Column(
        "events", "work", "count", "1", "events located", "events", gate="count", owner="solver"
    ),
    Column(
        "restarts",
        "work",
        "count",
        "1",
        "smooth arcs begun by an event-driven method",
        gate="count",
        owner="solver",
    ),
    Column(
        "rebuilds",
        "work",
        "count",
        "1",
        "times the neighbour list was built",
        gate="count",
        owner="solver",
    ),
    Column(
        "contacts_peak",
        "work",
        "count",
        "1",
        "most contacts at once: on the neighbour list, closed, or pushing (of a penalty)",
        gate="count",
        owner="solver",
    ),
    Column(
        "contacts",
        "work",
        "count",
        "1",
        "rows that were at work in the QP of a step, on average",
        owner="solver",
    ),
    Column(
        "rounds_worst",
        "work",
        "count",
        "1",
        "inner iterations of the step that took most",
        owner="solver",
    ),
    Column(
        "setups",
        "work",
        "count",
        "1",
        "factorisations set up anew by a QP library",
        owner="solver",
    ),
    Column(
        "limits",
        "work",
        "count",
        "1",
        "steps whose inner solver reached its iteration limit",
        owner="solver",
    ),
    Column(
        "ties",
        "work",
        "count",
        "1",
        "pushes between coincident centres, which have no normal",
        owner="solver",
    ),
    Column("pivots", "work", "count", "1", "principal or complementary pivots", owner="solver"),
    Column(
        "kkt",
        "work",
        "number",
        "state",
        "largest residual of the optimality conditions of the QPs",
        owner="solver",
    ),
    Column(
        "refused_steps", "work", "count", "1", "steps that error control rejected", owner="solver"
    ),
    Column("longest_step", "work", "number", "time", "longest accepted step", owner="solver"),
    Column(
        "segments",
        "work",
        "count",
        "1",
        "pieces of a run between two updates of its neighbour list",
        owner="solver",
    ),
    Column(
        "spread",
        "work",
        "number",
        "state",
        "largest difference from the extrapolation with one level less: an error estimate",
        owner="solver",
    ),
    Column(
        "roots",
        "work",
        "word",
        "",
        "how events were searched for: verified (every step is proven to hide none) or sampled",
        owner="solver",
    ),
    Column(
        "unproven",
        "work",
        "count",
        "1",
        "steps with a part on which nothing is proven",
        owner="solver",
    ),
    Column("refused", "work", "count", "1", "steps of a smooth arc taken again", owner="solver"),
    Column(
        "touches",
        "work",
        "count",
        "1",
        "dips and touches that are no event: nothing tells them from a near miss",
        owner="solver",
    ),
    Column(
        "accumulation",
        "work",
        "number",
        "time",
        "time at which switching events accumulate",
        owner="solver",
    ),
    Column(
        "loop", "work", "word", "", "loop over steps: compiled or host (Python)", owner="solver"
    ),
    Column(
        "note",
        "work",
        "word",
        "",
        "why the loop of a run was in Python, and why event-driven steps are not proven to hide no "
        "event: what cannot be traced, in which line, and what to write instead",
        owner="solver",
    ),
    Column("integrator", "work", "word", "", "integrator that a penalty chose", owner="solver"),
)
CLOCK = (
    Column(
        "setup_seconds", "clock", "number", "s", "preparation, as every call of prepare pays it"
    ),
    Column(
        "compile_seconds",
        "clock",
        "number",
        "s",
        "what the first preparation in a process takes beyond: compilation, loading, imports",
    ),
    Column("seconds", "clock", "number", "s", "the run alone: median over its rounds"),
    Column("seconds_low", "clock", "number", "s", "lower quartile over its rounds"),
    Column("seconds_high", "clock", "number", "s", "upper quartile over its rounds"),
    Column("seconds_max", "clock", "number", "s", "worst round"),
    Column(
        "rounds",
        "clock",
        "count",
        "1",
        "rounds it was timed in, interleaved with the other runs of its case; 1: a long run, "
        "timed once",
    ),
    Column(
        "step_max_seconds",
        "clock",
        "number",
        "s",
        "slowest step, of solvers that can tell",
        owner="solver",
    ),
    Column(
        "session",
        "clock",
        "word",
        "",
        "runs with the same word were timed on one machine in one go",
    ),
    Column(
        "shared",
        "clock",
        "flag",
        "",
        "true: made by a worker of a cluster, which may have had other work: its seconds are "
        "compared with none",
    ),
)
