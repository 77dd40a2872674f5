"""Check: explicit steps in a corner of surfaces where Filippov's velocity is not unique.

Where two or more surfaces meet and the field is not affine in their signs, Filippov's set holds
many velocities that stay in the corner. Explicit steps alternate between the modes and select one
that is not that of multilinear weights (Alexander & Seidman 1998).
"""

from __future__ import annotations

import numpy as np

from nsbench.case.scale import time_text
from nsbench.diagnostics.base import Finding
from nsbench.diagnostics.filippov.nonunique_motion import STEPS_PER_INTERVAL
from nsbench.diagnostics.run_view import RunView, thin_samples
from nsbench.dynamics.filippov.modes import count_surfaces, sign_patterns
from nsbench.dynamics.filippov.switch_rates import evaluate_or_nan

NEAR_IN_STEPS = 4.0  # a state this near to a surface at both ends of an interval stays on it
MAX_SURFACES = 10  # of one corner: of more, the modes are too many to be evaluated
ONE_SIDED = 1e-9  # mean weight of a side below which a run was on the other side alone
NOT_AFFINE = 1e-9  # of the largest field: more than rounding leaves of an affine fit


def check_corner_velocity(run: RunView) -> Finding | None:
    """Find explicit steps that stay in a corner of modes that are not affine in their signs.

    The corner is passed, and not stayed in, if all its modes cross one of its surfaces in the same
    direction. Cases that are declared not unique are not checked.
    """
    step = run.explicit_step
    if not step or not run.case.unique:
        return None
    problem = run.case.problem
    d = count_surfaces(problem, run.case.n)
    if d < 2:
        return None
    traj = run.trajectory
    chosen = thin_samples(traj.t, STEPS_PER_INTERVAL * step)
    t = traj.t[chosen]
    both = _both_sides(traj, chosen, d)
    for k in np.flatnonzero(both.sum(axis=1) > 1):
        x = traj.x[chosen[k + 1]]
        rows = np.flatnonzero(both[k])
        near = [
            _modes_of_corner(run, float(t[j]), traj.x[chosen[j]], rows, step)[0] for j in (k, k + 1)
        ]
        rows = rows[np.all(near, axis=0)]
        if len(rows) < 2 or len(rows) > MAX_SURFACES:
            continue
        _, f, changes = _modes_of_corner(run, float(t[k + 1]), x, rows, step)
        if np.any((changes.min(axis=0) > 0.0) | (changes.max(axis=0) < 0.0)):
            continue
        # least-squares fit of the modes by a field affine in the signs
        affine = np.column_stack((np.ones(len(f)), sign_patterns(len(rows))))
        off = np.abs(f - affine @ np.linalg.lstsq(affine, f, rcond=None)[0]).max()
        if off > NOT_AFFINE * np.abs(f).max():
            return Finding(
                "unverified",
                f"From t = {time_text(t[k], 6)} to {time_text(t[k + 1], 6)} the state stays in the "
                "corner of surfaces "
                f"{', '.join(map(str, rows))}, where Filippov's velocities are many: which one an "
                "explicit step makes by alternating between modes is no claim of it.",
            )
    return None


def _both_sides(traj, chosen, d: int) -> np.ndarray:
    """(len(chosen) - 1, d) bool: both sides made the motion of an interval, by mean weights."""
    spans = np.diff(traj.t)[:, None]
    weights = np.zeros((len(spans), d))
    weights[:, [ident[1] for ident in traj.contacts]] = np.diff(traj.impulse, axis=0) / spans
    total = np.append(np.zeros((1, d)), np.cumsum(weights * spans, axis=0), axis=0)
    theta = np.diff(total[chosen], axis=0) / np.diff(traj.t[chosen])[:, None]
    return (theta > ONE_SIDED) & (theta < 1.0 - ONE_SIDED)


def _modes_of_corner(run, t: float, x: np.ndarray, rows: np.ndarray, step: float):
    """Evaluate the modes of a corner at (t, x): those with all signs of the surfaces `rows`.

    The other signs are those of their switches. Of more than MAX_SURFACES rows only modes that
    differ from one another in one sign are taken.
    Returns (r,) bool: a row is within some steps of x; (modes, n) the fields; (modes, r) the change
    of the rows in one step.
    """
    c = evaluate_or_nan(run.switch, t, x)
    if len(rows) <= MAX_SURFACES:
        patterns = sign_patterns(len(rows))
    else:
        patterns = np.vstack([np.where(np.eye(len(rows)) > 0, e, -e) for e in (1.0, -1.0)])
    signs = np.tile(np.where(c >= 0.0, 1.0, -1.0), (len(patterns), 1))
    signs[:, rows] = patterns
    f = np.array([np.broadcast_to(evaluate_or_nan(run.field, t, x, s), x.shape) for s in signs])
    changes = np.array([(evaluate_or_nan(run.switch, t + step, x + step * v) - c)[rows] for v in f])
    return np.abs(c[rows]) <= NEAR_IN_STEPS * np.abs(changes).max(axis=0), f, changes
