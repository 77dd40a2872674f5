"""Make a stored reference: two integrators at two tolerances must agree, and a fixed-step method must come closer."""
from __future__ import annotations

import platform
from importlib import metadata

import numpy as np

from nsbench import solvers
from nsbench.case import Case
from nsbench.problem import Complementarity
from nsbench.reference.known import Reference, columns_of, spread
from nsbench.reference.stored import load, store
from nsbench.trajectory import Trajectory

SAFETY = 2.0                        # on the difference of two runs: neither is the better one for certain
LIMIT = 1e-8                        # relative; two good runs that differ by more did not follow the same path
METHODS = (("event_driven", 1e-13), ("event_driven[method=rk45]", 1e-12))
WITNESS = (4, 16)                   # steps of the witness, in units of the fewest per sample that the case asks for


def build(case: Case, folder=None, methods=METHODS, limit: float = LIMIT, witness: str | None = "auto") -> Reference:
    """Run both methods, compare, store; the first one is kept.

    Its own error: SAFETY times the largest difference of the two in state, impulse and reaction. Impulses may differ
    (multipliers that are not unique); their bound says so. witness: a method of another kind, which shares no code
    with the event-driven core ("auto": pbd with constraints, else euler); its distance must shrink when its step is
    divided by four. ValueError where a run is not ok, the two differ by more than `limit` relative to the largest
    state, or the witness does not come closer.
    """
    if not case.unique:
        raise ValueError(f"{case.key} has no unique solution: no reference is allowed")
    runs = [_run(case, spec, accuracy) for spec, accuracy in methods]
    a, b = runs
    scale = max(1.0, float(np.abs(a.x).max()))
    state, reaction, impulse = differences(case, a, b)
    if state > limit * scale or reaction > limit * scale:
        raise ValueError(f"{case.key}: {methods[0][0]} and {methods[1][0]} differ by {state:.2e} in the state and "
                         f"{reaction:.2e} in the reaction; at most {limit * scale:.0e} is allowed: nothing is stored")
    how = f"{methods[0][0]} at {methods[0][1]:g} against {methods[1][0]} at {methods[1][1]:g}"
    how += _witness(case, a, witness, scale)
    floor = 1e-15 * scale
    smooth = a.reaction.size == 0
    ref = Reference(a.t, a.x, a.contacts, a.impulse, None if smooth else a.reaction, a.events,
                    max(SAFETY * state, floor), max(SAFETY * impulse, floor),
                    float("nan") if smooth else max(SAFETY * reaction, floor), "stored", how, versions())
    store(case, ref, folder)
    return ref


def verify(case: Case, folder=None, methods=METHODS) -> str:
    """Read the stored reference and run its second method again: a sentence, or ValueError if they disagree."""
    ref = load(case, folder)
    if ref is None:
        raise ValueError(f"{case.key} has no stored reference")
    again = _run(case, *methods[1])
    state, reaction, _ = differences(case, ref, again)
    # the difference is half the stored bound where nothing has changed
    for name, got, bound in (("state", state, ref.state_error), ("reaction", reaction, ref.reaction_error)):
        if got > max(bound, 1e-13 * max(1.0, np.abs(ref.x).max())):
            raise ValueError(f"{case.key}: the stored {name} and {methods[1][0]} differ by {got:.2e}; "
                             f"the bound is {bound:.2e}")
    return f"confirmed by {methods[1][0]}: state differs by {state:.1e} (bound {ref.state_error:.1e})"


def _run(case, spec, accuracy) -> Trajectory:
    traj = solvers.solve(case, spec, **{solvers.get(spec).accuracy: accuracy})
    if not traj.status.ok:
        raise ValueError(f"{case.key}: {spec} ended with {traj.status.code}: {traj.status}")
    if not (np.array_equal(traj.t, case.t) and np.all(np.isfinite(traj.x)) and np.all(np.isfinite(traj.impulse))):
        raise ValueError(f"{case.key}: {spec} says ok, but its samples are not finite or not at the case's times")
    return traj


def differences(case, a, b) -> tuple[float, float, float]:
    """Largest differences in state, reaction (0 for a Filippov system) and impulse."""
    state = float(np.abs(a.x - b.x).max())
    reaction = 0.0
    if a.reaction is not None and b.reaction is not None and a.reaction.size:
        reaction = float(np.abs(a.reaction - b.reaction).max())
    columns = columns_of(case.problem, a.contacts, b.contacts)
    da, db = (spread(case.problem, r.contacts, r.impulse, columns) for r in (a, b))
    return state, reaction, float(np.abs(da - db).max(initial=0.0))


def _witness(case, ref, spec, scale) -> str:
    if spec == "auto":
        spec = "pbd" if isinstance(case.problem, Complementarity) and case.problem.constraints else "euler"
    if spec is None or solvers.get(spec).accuracy != "h" or solvers.get(spec).refuses(case):
        return ""
    spacing = float(np.diff(case.t).min())
    steps = [n * max(2, case.substeps) for n in WITNESS]
    far, near = (float(np.abs(solvers.solve(case, spec, h=spacing / n).x - ref.x).max()) for n in steps)
    # an exact witness has nothing to come closer with; else first order promises a quarter, half is asked
    if not (near <= 1e-9 * scale or near <= 0.5 * far):
        raise ValueError(f"{case.key}: {spec} is {far:.2e} away with {steps[0]} steps per sample and {near:.2e} with "
                         f"{steps[1]}: it does not come closer, nothing is stored")
    return f"; {spec} comes from {far:.1e} to {near:.1e} when its step is divided by four"


def versions() -> dict:
    return {"python": platform.python_version()} | {p: metadata.version(p) for p in ("nsbench", "numpy", "scipy")}
