"""Trajectory, resolution and status of a penalty run, from the results of its integrator."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from nsbench.case import Case
from nsbench.case.scale import time_text
from nsbench.problem import Complementarity, Filippov
from nsbench.solvers.common.extrapolation import weights
from nsbench.trajectory import Resolution, Status, Trajectory

if TYPE_CHECKING:
    from nsbench.solvers.penalty.method import Penalty

EXPLICIT = {"tsit5": 6, "dopri8": 13, "bosh3": 3}  # right-hand sides of a step
# as nsbench.solvers.penalty.integrator counts why a step was refused; that needs diffrax to be
# loaded
NOT_FINITE = 2
NEWTON = 3
# largest tolerance over the claimed error that does not hide it: met up to k = 1e7 at 1e-9; errors
# of up to 190 tolerances were measured
HIDDEN = 0.0101


def build_trajectory(penalty: Penalty, case: Case, k: float, asked: float, out: dict) -> Trajectory:
    """Assemble the trajectory of a run with stiffness k.

    penalty: the method with its options; asked: the stiffness of the coarsest level of an
    extrapolation, to which its claims refer; out: samples and counts of the integrator.
    """
    impulse = out["impulse"]
    ids = out["ids"]
    pushes = np.diff(impulse[: int(out["i"])], axis=0) > 0.0
    acted = np.arange(len(ids))
    if isinstance(case.problem, Complementarity):
        acted = np.flatnonzero(pushes.any(axis=0))
    steps = int(out["accepted"])
    refused = int(out["refused"])
    stats = {
        "steps": steps,
        "h": 1.0 / k,
        "refused_steps": refused,
        "longest_step": float(out["longest"]),
        "contacts_peak": int(pushes.sum(axis=1).max(initial=0)),
        "loop": "compiled",
        "integrator": penalty.method,
    }
    if "segments" in out:
        stats["segments"] = out["segments"]
    if penalty.method in EXPLICIT:
        stats["drift_calls"] = out.get("segments", 1) + (steps + refused) * EXPLICIT[penalty.method]
    return Trajectory(
        case.t,
        out["x"],
        tuple(ids[a] for a in acted),
        impulse[:, acted],
        out["reaction"],
        _status(penalty, case, k, out),
        (),
        stats,
        "mean",
        between=out.get("between"),
        resolution=_resolution(penalty, case, k, asked),
    )


def _resolution(penalty, case: Case, k: float, asked: float) -> Resolution:
    """State the layer of switches, and which tolerance would hide the error that is claimed."""
    own = asked / penalty.accuracy_unit(case)
    claimed = own ** -(1.0 + penalty.extrapolate)
    # weights of an extrapolation amplify what the integrator leaves
    amplified = float(np.abs(weights(penalty.extrapolate)).sum())
    return Resolution(
        layer=1.0 / k if isinstance(case.problem, Filippov) else 0.0,
        tolerance=max(penalty.tolerance("rtol", own), penalty.tolerance("atol", own)),
        claimed_error=claimed,
        max_tolerance=HIDDEN * claimed / amplified,
        stiffness=0.0 if isinstance(case.problem, Filippov) else k,
    )


def _status(penalty, case: Case, k: float, out: dict) -> Status:
    """Judge by the samples whether the run reached its end, and if not, why."""
    t = float(out["t"])
    tried = int(out["accepted"]) + int(out["refused"])
    at = f"at t = {time_text(t, 6)} of {time_text(case.t[-1], 6)}"
    if (
        int(out["i"]) == len(case.t)
        and np.isfinite(out["x"]).all()
        and np.isfinite(out["impulse"]).all()
    ):
        return Status()
    if tried < penalty.step_limit:
        return _no_step(penalty, case, k, out, at)
    last = float(out["last"])
    advice = (
        "an explicit method needs about k T / 3 of them: take method=kvaerno5 or a smaller k"
        if penalty.method in EXPLICIT
        else "raise max_steps, rtol or atol"
    )
    return Status(
        "maxiter",
        f"The penalty is too stiff for {penalty.step_limit} steps: {at} their length was "
        f"{last:.1e} (k h = {k * last:.2g}); {advice}.",
    )


def _no_step(penalty, case: Case, k: float, out: dict, at: str) -> Status:
    """Explain why no step succeeds, however short."""
    if np.abs(out["z"][: case.n]).max() > 1e6 * (1.0 + np.abs(case.x0).max()):
        return Status("diverged", f"The state grew beyond all bounds {at}.")
    if out["cause"] == NOT_FINITE:
        return Status(
            "nan", f"The right-hand side is not finite just after the point reached {at}."
        )
    if out["cause"] == NEWTON:
        return Status(
            "maxiter",
            f"Newton's iteration of {penalty.method} failed at every step size {at}; lower k.",
        )
    return Status(
        "maxiter",
        f"The step size fell to {float(out['h']):.1e} {at}: the tolerances cannot be met at "
        f"k = {k:g} in double precision; raise rtol and atol or lower k.",
    )
