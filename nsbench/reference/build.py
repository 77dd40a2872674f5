"""Build and verify stored references: certified for small scenes, else two runs and a witness.

A reference without certificate is that of two integrators that agree, and a witness where one of
another kind takes the case.
"""

from __future__ import annotations

import dataclasses
import math
import platform
from importlib import metadata

import numpy as np

from nsbench import solvers
from nsbench.case import Case
from nsbench.problem import Complementarity, Hybrid
from nsbench.reference.certify import certificate
from nsbench.reference.comparison import bounded_by, differences
from nsbench.reference.reference import Reference, closed_form
from nsbench.reference.storage import load, store
from nsbench.trajectory import Trajectory

SAFETY = 2.0  # on the difference of two runs: neither is the better one for certain
LIMIT = 1e-8  # relative; two good runs that differ by more did not follow the same path,
AMPLIFIED = 1e-4  # but where they have the same events: the flow amplifies what they leave
METHODS = (("event_driven", 1e-13), ("event_driven[method=rk45]", 1e-12))
# steps of the witness, in units of the fewest per sample that the case asks for: far and near
WITNESS = ((4,), (16,))
# Transitions at the ends of steps are late by any part of a step, so that the error of one run may
# be small by chance: the largest of several counts as that of the far one.
WITNESS_OF_TRANSITIONS = ((4, 5, 6, 7), (64,))
# times as many steps, where the first do not come closer (errors of a method that chatters scatter)
# or end farther than
WITNESS_STEPS = (1, 16, 256)
NEAR = 0.1  # of the largest state: an error that large follows no order yet
ROUNDING = 1e-13  # relative; what sums of thousands of steps leave
TIGHTER = 10.0  # is the tolerance of a second try to confirm a reference
SPREAD = 10.0  # a run may be this many times the difference of two of them off a proven solution
KINDS = ("auto", "certified", "runs")
UNPROVEN = "the bound comes from two integrators that agree, it is not proven; no certificate"


def build(
    case: Case,
    folder=None,
    methods=METHODS,
    limit: float = LIMIT,
    witness: str | None = "auto",
    kind: str = "auto",
) -> Reference:
    """Compute a reference of a case and store it in `folder`.

    kind "certified": a proof; "runs": two runs that agree; "auto": the first, or the second with
    the reason why; a proof that takes minutes is made for "certified" alone.

    Two runs: the first one is stored; the bound of its error is SAFETY times the largest difference
    of the two in state, impulse, reaction and event times. Impulses may differ (multipliers that
    are not unique); their bound says so. witness: a method of another kind, which shares no code
    with the event-driven core ("auto": pbd with constraints, else euler); its distance must shrink
    when its step is divided by four.

    Raises ValueError if the proof cannot be made (kind "certified"), if a run is not ok, if the two
    differ by more than `limit` relative to the largest state (AMPLIFIED if both have the same
    events in the same order: the bound, which is twice the difference, says by how much the flow
    amplifies errors), or if the witness does not come closer.
    """
    if not case.unique:
        raise ValueError(f"{case.key} has no unique solution: no reference is allowed")
    if kind not in KINDS:
        raise ValueError(f"kind is {kind!r}; one of {', '.join(KINDS)}")
    why = ""
    if kind != "runs":
        try:
            ref = certified(case, certificate.OPERATIONS if kind == "auto" else math.inf)
            store(case, ref, folder)
            return ref
        except (
            ValueError,
            ArithmeticError,
            NotImplementedError,
            TypeError,
        ) as e:  # what a drift's own code may raise
            if kind == "certified":
                raise ValueError(f"{case.key} is not certified: {e}") from e
            why = f"; {UNPROVEN}: {e}"
    ref = _two_runs(case, methods, limit, witness)
    ref = dataclasses.replace(ref, how=ref.how + why)
    store(case, ref, folder)
    return ref


def certified(case: Case, operations: float = math.inf) -> Reference:
    """Build the certified reference and compare it with a run of the fast method.

    operations: see certificate.certify. Raises ValueError if the two differ.
    """
    ref = certificate.certify(case, operations=operations).reference
    run = _run(case, *METHODS[0])
    state, reaction, _, _ = differences(case, ref, run)
    scale = max(1.0, float(np.abs(ref.x).max()))
    if max(state, reaction) > certificate.AGREE * scale:
        raise ValueError(
            f"{case.key}: the certified solution and {METHODS[0][0]} differ by "
            f"{max(state, reaction):.1e}"
        )
    return dataclasses.replace(
        ref, how=f"{ref.how}; {METHODS[0][0]} at {METHODS[0][1]:g} differs by {state:.1e}"
    )


def _two_runs(case, methods, limit, witness) -> Reference:
    """Build a reference from two integrators at two tolerances, checked by a witness."""
    a, b = (_run(case, spec, accuracy) for spec, accuracy in methods)
    scale = max(1.0, float(np.abs(a.x).max()))
    state, reaction, impulse, times = differences(case, a, b)
    off = max(state, reaction) / scale
    limit = max(limit, AMPLIFIED) if np.isfinite(times) else limit
    if off > limit:
        raise ValueError(
            f"{case.key}: {methods[0][0]} and {methods[1][0]} differ by {state:.2e} in the state "
            f"and "
            f"{reaction:.2e} in the reaction; at most {limit * scale:.0e} is allowed: nothing is "
            f"stored"
        )
    how = f"{methods[0][0]} at {methods[0][1]:g} against {methods[1][0]} at {methods[1][1]:g}"
    if off > LIMIT:
        how += ", which have the same events: the flow amplifies errors"
    how += _witness(case, a, witness, scale)
    floor = 1e-15 * scale
    smooth = a.reaction.size == 0
    return Reference(
        a.t,
        a.x,
        a.contacts,
        a.impulse,
        None if smooth else a.reaction,
        a.events,
        max(SAFETY * state, floor),
        max(SAFETY * impulse, floor),
        float("nan") if smooth else max(SAFETY * reaction, floor),
        "stored",
        how,
        versions(),
        max(SAFETY * times, 1e-15 * max(1.0, float(np.abs(case.t).max()))),
    )


def verify(case: Case, folder=None, methods=METHODS, certify: bool = False) -> str:
    """Recompute a stored reference; return a sentence, or raise ValueError if it disagrees.

    By default runs are repeated: the second method must lie within the bound of two runs, and of a
    certified reference within the bound and SPREAD times the difference of both methods.
    certify=True makes a certified reference anew, proof and all.
    """
    ref = load(case, folder)
    if ref is None:
        raise ValueError(f"{case.key} has no stored reference")
    if case.exact is not None and ref.kind == "certified":
        bounded_by(case, closed_form(case), ref)
    if certify and ref.kind == "certified":
        return _verify_proof(case, ref)
    spec, accuracy = methods[1]
    try:
        return _confirm(case, ref, spec, accuracy, methods[0])
    except ValueError:
        # its own error may be beyond the bound: a tighter run tells
        return _confirm(case, ref, spec, accuracy / TIGHTER, methods[0])


def _confirm(case, ref, spec, accuracy, first) -> str:
    """Compare a reference with a run of another method; `first`: that of the reference itself."""
    again = _run(case, spec, accuracy)
    state, reaction, _, times = differences(case, ref, again)
    scale = max(1.0, float(np.abs(ref.x).max()))
    slack = time_slack = 0.0
    if ref.kind == "certified":
        s, r, _, time_slack = differences(case, _run(case, *first), again)
        slack = SPREAD * max(s, r)
        if not slack <= certificate.AGREE * scale:
            raise ValueError(
                f"{case.key}: the two methods differ by {slack / SPREAD:.1e}: nothing can be "
                f"confirmed"
            )
    # the difference is half the stored bound where nothing has changed
    for name, got, bound in (
        ("state", state, ref.state_error + slack),
        ("reaction", reaction, ref.reaction_error + slack),
        ("event times", times, ref.event_error + SPREAD * time_slack),
    ):
        if got > max(bound, ROUNDING * scale):
            raise ValueError(
                f"{case.key}: the stored {name} and {spec} differ by {got:.2e}; "
                f"the bound is {bound:.2e}"
            )
    bound = f"{ref.kind}, bound {ref.state_error:.1e}"
    return f"confirmed by {spec}: state differs by {state:.1e} ({bound})"


def _verify_proof(case, ref) -> str:
    """Make the proof of a certified reference again and compare it with what is stored."""
    again = certificate.certify(case).reference
    found = differences(case, ref, again)
    for name, got in zip(("state", "reaction", "impulse", "event"), found, strict=True):
        bound = getattr(ref, f"{name}_error") + getattr(again, f"{name}_error")
        if not (got <= bound or (name == "reaction" and got == 0.0)):
            raise ValueError(
                f"{case.key}: the stored {'event times' if name == 'event' else name} and a new "
                f"certificate differ by {got:.2e}; both are within {bound:.1e}"
            )
    state = found[0]
    return f"proven again: state differs by {state:.1e} (bound {ref.state_error:.1e})"


def _run(case, spec, accuracy) -> Trajectory:
    """Run a method for a reference; raise ValueError unless it ends well.

    Errors that the flow amplifies show in the difference from a second run, which is the bound.
    """
    traj = solvers.solve(case, spec, **{solvers.get(spec).accuracy: accuracy})
    if not traj.status.ok and traj.status.check != "amplified_error":
        raise ValueError(f"{case.key}: {spec} ended with {traj.status.code}: {traj.status}")
    if not (
        np.array_equal(traj.t, case.t)
        and np.all(np.isfinite(traj.x))
        and np.all(np.isfinite(traj.impulse))
    ):
        raise ValueError(
            f"{case.key}: {spec} says ok, but its samples are not finite or not at the case's times"
        )
    return traj


def choose_witness(case: Case, spec: str | None = "auto") -> str | None:
    """Choose the witness of a case; None where that method refuses it, or takes no step."""
    if spec == "auto":
        p = case.problem
        spec = "pbd" if isinstance(p, Complementarity) and p.constraints else "euler"
    takes = spec and solvers.get(spec).accuracy == "h" and not solvers.get(spec).refuses(case)
    return spec if takes else None


def describe_attempt(case: Case) -> str:
    """Say what a reference is made of: ``a proof, or two integrators and a witness (pbd)``."""
    witness = choose_witness(case)
    runs = f"two integrators{f' and a witness ({witness})' if witness else ', without a witness'}"
    return runs if certificate.why_not(case) else f"a proof, or {runs}"


def _witness(case, ref, spec, scale) -> str:
    """Check that a method of another kind comes closer to the reference with smaller steps."""
    spec = choose_witness(case, spec)
    if spec is None:
        return ""
    spacing = float(np.diff(case.t).min())
    witness = WITNESS_OF_TRANSITIONS if isinstance(case.problem, Hybrid) else WITNESS
    steps = [[n * max(2, case.substeps) for n in group] for group in witness]
    compared = _away_from_jumps(case, ref)

    def states(steps: list[int]) -> np.ndarray:
        return np.array([solvers.solve(case, spec, h=spacing / n).x for n in steps])

    for finer in WITNESS_STEPS:
        coarse, fine = (states([finer * n for n in group]) for group in steps)
        off, closer = (np.abs(x - ref.x).max(axis=(0, 2)) for x in (coarse, fine))
        lost = compared & ~(off <= NEAR * scale)
        confirmed = compared & (np.cumsum(lost) == 0)
        far, near = (float(d[confirmed].max(initial=0.0)) for d in (off, closer))
        # an exact witness has nothing to come closer with; else first order promises a quarter,
        # half is asked
        comes_closer = near <= 1e-9 * scale or near <= 0.5 * far
        if comes_closer and not lost.any():
            break
    # where the flow amplifies errors, a witness of first order confirms what comes before; its own
    # runs differ as much there: if not, they have another solution
    own = np.abs(coarse[0] - fine[0]).max(axis=1)
    is_other = lost.any() and own[lost].max() <= 0.5 * closer[lost].max()
    if is_other or not confirmed[1:].any() or not comes_closer:
        raise ValueError(
            f"{case.key}: {spec} is {off[compared].max():.2e} away with {finer * steps[0][0]} "
            f"steps per sample and {closer[compared].max():.2e} with "
            f"{finer * steps[1][0]}: it does not come closer, nothing is stored"
        )
    times = "four" if witness is WITNESS else "sixteen"
    how = f"; {spec} comes from {far:.1e} to {near:.1e} when its step is divided by {times}"
    return f"{how}, up to t = {case.t[confirmed][-1]:.4g}" if lost.any() else how


def _away_from_jumps(case, ref) -> np.ndarray:
    """Mark the samples (k,) that no transition of a hybrid system is nearer to than a spacing.

    Nearer ones may lie on the other side of a jump whose time is wrong by the order of the step; if
    no others exist, all are marked.
    """
    good = np.ones(len(case.t), bool)
    if isinstance(case.problem, Hybrid):
        for e in ref.events:
            good &= np.abs(case.t - e.t) > np.diff(case.t).max()
    return good if good[1:].any() else np.ones(len(case.t), bool)


def versions() -> dict:
    return {"python": platform.python_version()} | {
        p: metadata.version(p) for p in ("nsbench", "numpy", "scipy")
    }
