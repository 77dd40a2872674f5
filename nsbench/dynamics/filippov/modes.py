"""The modes of a Filippov system as corners of a box of signs, and whether its field is multilinear
between them."""

from __future__ import annotations

from itertools import product

import numpy as np

from nsbench.case import Case
from nsbench.compilation.factories import as_numpy
from nsbench.diagnostics.filippov.repulsive_surface import evaluate_or_nan
from nsbench.problem import Filippov

STEPS = 4.0  # of a run: so near to a surface at both ends of an interval is on it
# steps that an interval has at least, so that its weights are means; samples between are left out
LONG = 32.0
MANY = 10  # surfaces of one corner; of more, the modes are too many to look at
SIDE = 1e-9  # mean weight below which a run was on one side alone


def surfaces(problem: Filippov, n: int) -> int:
    """Their number."""
    return (
        problem.d if problem.d is not None else len(as_numpy(problem.switch)(0.0, np.full(n, 0.37)))
    )


def multilinear(problem: Filippov, n: int) -> bool:
    """Whether the field is affine in each sign, at some points drawn once; False where it is not
    finite."""
    rng = np.random.default_rng(0)
    field = as_numpy(problem.field)
    d = surfaces(problem, n)
    with np.errstate(all="ignore"):
        for _ in range(4):
            t = rng.uniform()
            x = rng.uniform(-1.0, 1.0, n)
            s = rng.uniform(-1.0, 1.0, d)
            f = evaluate_or_nan(field, t, x, s.copy())
            for i in range(d):
                plus, minus = (
                    evaluate_or_nan(field, t, x, np.where(np.arange(d) == i, e, s))
                    for e in (1.0, -1.0)
                )
                off = np.abs(0.5 * (1.0 + s[i]) * plus + 0.5 * (1.0 - s[i]) * minus - f)
                if not np.all(off <= 1e-12 * (1.0 + np.maximum(np.abs(plus), np.abs(minus)))):
                    return False
    return True


def sign_patterns(d: int) -> np.ndarray:
    """(2^d, d) signs."""
    return np.array(list(product((1.0, -1.0), repeat=d)))


def check_corner_velocity(case: Case, X: np.ndarray, weights: np.ndarray, h: float) -> str:
    """Where a run in steps of h, with these mean weights (K - 1, d) of the positive sides between
    samples, stays in the corner of two or more surfaces whose modes are not affine in their signs;
    "" if nowhere.

    There the velocities of Filippov's set are many, and alternating between modes picks one that is
    not that of multilinear weights. A corner is passed, not held, if all its modes cross a surface
    of it in the same direction.
    """
    d = surfaces(case.problem, case.n)
    if d < 2:
        return ""
    field = as_numpy(case.problem.field)
    switch = as_numpy(case.problem.switch)
    keep = thin_samples(case.t, LONG * h)
    t = case.t[keep]
    spans = np.diff(case.t)[:, None]
    theta = (
        np.diff(
            np.append(np.zeros((1, d)), np.cumsum(weights * spans, axis=0), axis=0)[keep], axis=0
        )
        / np.diff(t)[:, None]
    )
    mixed = (theta > SIDE) & (theta < 1.0 - SIDE)
    with np.errstate(all="ignore"):
        for k in np.flatnonzero(mixed.sum(axis=1) > 1):
            ends = [
                _modes(field, switch, float(t[j]), X[keep[j]], np.flatnonzero(mixed[k]), h)
                for j in (k, k + 1)
            ]
            rows = np.flatnonzero(mixed[k])
            rows = rows[np.all([near for near, _, _ in ends], axis=0)]
            if len(rows) < 2 or len(rows) > MANY:
                continue
            _, f, rates = _modes(field, switch, float(t[k + 1]), X[keep[k + 1]], rows, h)
            if np.any((rates.min(axis=0) > 0.0) | (rates.max(axis=0) < 0.0)):
                continue
            fit = np.column_stack((np.ones(len(f)), sign_patterns(len(rows))))
            off = np.abs(f - fit @ np.linalg.lstsq(fit, f, rcond=None)[0]).max()
            if off > 1e-9 * np.abs(f).max():
                return (
                    f"From t = {t[k]:.6g} to {t[k + 1]:.6g} the state stays in the corner of "
                    f"surfaces "
                    f"{', '.join(map(str, rows))}"
                )
    return ""


def thin_samples(t: np.ndarray, span: float) -> np.ndarray:
    """Samples, the first and the last among them, that are at least `span` apart as far as the run
    is that long."""
    keep = [0]
    for k in range(1, len(t) - 1):
        if t[k] - t[keep[-1]] >= span and t[-1] - t[k] >= span:
            keep.append(k)
    return np.array([*keep, len(t) - 1])


def _modes(field, switch, t: float, x: np.ndarray, rows: np.ndarray, h: float):
    """Of the modes with all signs of these rows and the others as they are: which rows are some
    steps near; the fields (modes, n); by how much a step changes the rows (modes, rows). Of many
    rows only modes that differ in one."""
    c = evaluate_or_nan(switch, t, x)
    some = (
        sign_patterns(len(rows))
        if len(rows) <= MANY
        else np.vstack([np.where(np.eye(len(rows)) > 0, e, -e) for e in (1.0, -1.0)])
    )
    signs = np.tile(np.where(c >= 0.0, 1.0, -1.0), (len(some), 1))
    signs[:, rows] = some
    f = np.array([np.broadcast_to(evaluate_or_nan(field, t, x, s), x.shape) for s in signs])
    rates = np.array([(evaluate_or_nan(switch, t + h, x + h * v) - c)[rows] for v in f])
    return np.abs(c[rows]) <= STEPS * np.abs(rates).max(axis=0), f, rates
