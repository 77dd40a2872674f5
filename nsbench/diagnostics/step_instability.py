"""Check: fixed steps beyond the stability limit of an explicit method.

An explicit step h multiplies what decays with rate r by 1 - r h, which grows beyond r h = 2
(Hairer & Wanner, Solving Ordinary Differential Equations II, section IV.2).
"""

from __future__ import annotations

import numpy as np

from nsbench.case.scale import size_text, span_text, time_text
from nsbench.compilation.factories import as_numpy
from nsbench.diagnostics.base import Finding
from nsbench.diagnostics.run_view import RunView
from nsbench.dynamics.contacts.tolerances import scene_of
from nsbench.trajectory import Trajectory

GROWTH = 10.0  # of the largest coordinate, over that of the start and of half of the samples
STABILITY_LIMIT = 2.0  # of r h
NUDGE = 2.0**-20  # of own length, for differences of the drift
CLOSED = 1e-9  # of own length: a gap that counts as none


def check_step_instability(run: RunView) -> Finding | None:
    """Find a sample at which the motion decays faster than explicit steps can follow.

    The rate is that of the drift's derivative along the velocity v, -(v . J v) / |v|^2, where v is
    the drift without what pushes into closed contacts. The run diverged if the state grew; walls
    may have caught it.
    """
    h = run.resolution.step
    if not h > 0.0 or run.resolution.rule != "explicit":
        return None
    drift = as_numpy(run.case.problem.drift)
    traj = run.trajectory
    for t, x in zip(traj.t, traj.x, strict=True):
        f = np.asarray(drift(float(t), x.copy()), float)
        if not h * _decay(drift, float(t), x, f) > STABILITY_LIMIT:
            continue
        rate = _decay(drift, float(t), x, _free_part(run, float(t), x, f))
        if h * rate > STABILITY_LIMIT:
            return _overshoot(traj, float(t), h, rate)
    return None


def _overshoot(traj: Trajectory, t: float, h: float, rate: float) -> Finding:
    sizes = np.abs(traj.x).max(axis=1, initial=0.0)
    k = int(np.argmax(sizes))
    why = (
        f"At t = {time_text(t, 6)} the motion decays within {span_text(1.0 / rate)}: steps of "
        f"{span_text(h)} overshoot; take them shorter than {span_text(STABILITY_LIMIT / rate)}."
    )
    if not sizes[k] > GROWTH * max(sizes[0], float(np.median(sizes))):
        return Finding("unverified", why)
    grew = f"The state grew to {size_text(sizes[k])} at t = {time_text(traj.t[k], 6)}."
    return Finding("diverged", f"{why} {grew}")


def _decay(drift, t: float, x: np.ndarray, v: np.ndarray) -> float:
    """Return -(v . J v) / |v|^2 by a difference of the drift along v; 0.0 for no velocity."""
    size = float(np.linalg.norm(v))
    if not 0.0 < size < np.inf:
        return 0.0
    step = NUDGE * max(1.0, float(np.abs(x).max())) / size * v
    slope = np.asarray(drift(t, x + step), float) - drift(t, x - step)
    return -float(slope @ step) / (2.0 * float(step @ step))


def _free_part(run: RunView, t: float, x: np.ndarray, f: np.ndarray) -> np.ndarray:
    """Return the projection of the drift f on the velocities that violate no closed contact."""
    from scipy.optimize import nnls

    scene = scene_of(run.case)
    near = scene.near(x, CLOSED * max(1.0, float(np.abs(x).max())), t)
    near = near.take(scene.gaps(t, x, near) <= CLOSED * max(1.0, float(np.abs(x).max())))
    if not len(near):
        return f
    G = scene.dense_gradients(t, x, near)
    v = f + G.T @ nnls(G.T, -f)[0]
    return v if np.linalg.norm(v) > CLOSED * np.linalg.norm(f) else np.zeros_like(f)
