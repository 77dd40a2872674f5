"""Own residuals: a run held against its equation alone, with as many samples as that takes.

What a run lacks over an interval is its residual there times the length, a way; `missing` is what all intervals lack. A kink
or a jump of the drift inside an interval deceives the quadrature by a way that shrinks with the interval, by its length or
faster; a velocity that is wrong for a while, a jump or a push that is not the equation's lack the same whatever the samples.
"""
from __future__ import annotations

import numpy as np

from nsbench.measure.frame import frame
from nsbench.measure.residuals import interval_residuals
from randomised.ladder import stiffness
from randomised.runs import attempt

ROUNDS = 12                 # of finer samples where something is missing: 4^12 times finer than the finest even ones
WORST = 40                  # intervals that a round divides at most
MISSING = 1e-7              # of the way that the largest velocity makes in a run: may be missing of one that claims a bound
OWN = 1e-5                  # the same for steps
COARSER = (16, 4, 1)        # than the finest steps that can be samples
MORE, SHORTER = 10, 8       # samples, and steps between them, where defects stay: they may be too long for a stiff drift
STIFF = (100.0, 400.0, 1600.0)          # and k with PARTS samples to a spacing
PARTS = 40
NODES = 3000                # samples at most
STAYS = 0.5                 # what does not fall to that part of its largest with 16 to 64 times finer steps stays


def missing(case, traj) -> np.ndarray:
    """(k - 1,) the way that each interval lacks."""
    with np.errstate(all="ignore"):
        return interval_residuals(frame(case), traj) * np.diff(traj.t)


def finer(t: np.ndarray, lacks: np.ndarray) -> np.ndarray:
    """t with three more times in each of the intervals that lack most and their neighbours."""
    bad = np.argsort(-lacks)[:WORST]
    bad = bad[lacks[bad] > 1e-2 * lacks[bad[0]]]
    bad = np.unique(np.clip(bad[:, None] + np.arange(-2, 3), 0, len(lacks) - 1))
    bad = bad[np.diff(t)[bad] > 1e-12 * max(1.0, float(np.abs(t).max()))]
    return np.unique(np.concatenate([t, *(t[bad] + s * np.diff(t)[bad] for s in (0.25, 0.5, 0.75))]))


def filled(run, case, t, allowed: float):
    """What is missing, round by round, until it is at most `allowed` (a way) or divided samples do not help.

    run(t) -> a trajectory that says ok with samples t, or None (told otherwise). The list, and the last trajectory or None.
    """
    found = []
    for _ in range(ROUNDS):
        traj = run(t)
        if traj is None:
            return found, None
        lacks = np.nan_to_num(missing(case.replace(t=t), traj), nan=np.inf)
        found.append(float(lacks.sum()))
        more = finer(t, lacks)
        if found[-1] <= allowed or not np.isfinite(found[-1]) or len(more) == len(t):
            return found, traj
        t = more
    return found, traj


def settled(case, spec: str, method, unit: float, why: str, verdict):
    """A method of a claimed order where there is no answer: do its defects fall with finer steps, or stay? A Verdict.

    Defects are what is missing in all intervals, the greatest depth, and the integral of gap x multiplier,
    with each step a sample.
    """
    found, last = [], None
    for v, t in _fine(case, spec, method):
        if last is not None and not _stays(found):
            break
        run = attempt(case.replace(t=t), spec, v)
        if run.crash:
            return verdict("crash", "", f"at {v:g} with more samples: {run.crash}")
        if not run.ok:
            return verdict("open", "ok", why)
        found.append(_defects(case.replace(t=t), run, unit))
        last = v if len(found) == len(COARSER) else last
    if len(found) < len(COARSER):
        return verdict("open", "ok", why)
    stays = _stays(found)
    return verdict("wrong", "ok", f"{stays}; {why}") if stays else verdict("own", "ok", why)


def _stays(found) -> str:
    """Which defect does not fall, if one does not."""
    for name, *before, last in zip(("missing", "depth", "complementarity"), *found, strict=True):
        if not last <= max(OWN, STAYS * max(before)):
            return f"{name} " + ", ".join(f"{v:.1e}" for v in (*before, last)) + " with ever finer steps"
    return ""


def _fine(case, spec, method):
    """(h or k, samples): every step a sample, as many as NODES allows; then more samples, and shorter steps."""
    spacing = np.diff(case.t)
    if "richardson" in spec or "extrapolate" in spec:           # no step of theirs is one of a motion
        return
    if method.accuracy == "k":
        parts = max(2, min(PARTS, NODES // len(spacing)))
        for k in STIFF:
            yield k * stiffness(case), _divided(case.t, parts)
        yield 64.0 * STIFF[-1] * stiffness(case), _divided(case.t, MORE * parts)
        return
    most = max(COARSER[0], NODES // len(spacing))
    for n in COARSER:
        t = _divided(case.t, most // n)
        yield float(np.diff(t).min()), t
    t = _divided(case.t, MORE * most)
    yield float(np.diff(t).min()) / SHORTER, t


def _divided(t, parts):
    return np.append((t[:-1, None] + np.diff(t)[:, None] * np.arange(parts) / parts).ravel(), t[-1])


def _defects(case, run, unit):
    """The three defects of a run, relative to its size."""
    traj = run.traj
    size = max(unit, float(np.abs(np.diff(traj.x, axis=0) / np.diff(traj.t)[:, None]).max()))
    T, moved = float(traj.t[-1] - traj.t[0]), max(unit, float(np.abs(traj.x - traj.x[0]).max()))
    first = len(traj.t) // 2 if case.start == "keep" else 0     # that may be infeasible, and is mended in some steps
    lacks = float(np.nan_to_num(missing(case, traj), nan=np.inf)[first:].sum()) / (size * T)
    scene = frame(case).scene
    depth = max(scene.deepest(a, b) for a, b in zip(traj.t[first:], traj.x[first:], strict=True)) / moved if scene else 0.0
    complementary = run.measured["complementarity"]
    return lacks, depth, 0.0 if np.isnan(complementary) else complementary / (size * moved)
