"""The modes of a Filippov system as corners of a box of signs, and whether its field is multilinear between them."""
from __future__ import annotations

from itertools import product

import numpy as np

from nsbench.case import Case
from nsbench.problem import Filippov

STEPS = 4.0              # of a run: so near to a surface at both ends of an interval is on it
SIDE = 1e-9              # mean weight below which a run was on one side alone


def surfaces(problem: Filippov, n: int) -> int:
    """Their number."""
    return problem.d if problem.d is not None else len(problem.switch(np)(0.0, np.full(n, 0.37)))


def multilinear(problem: Filippov, n: int) -> bool:
    """Whether the field is what its corners make of it, at some points drawn once; False where it is not finite."""
    rng, field, d = np.random.default_rng(0), problem.field(np), surfaces(problem, n)
    with np.errstate(all="ignore"):
        for _ in range(4):
            t, x, s = rng.uniform(), rng.uniform(-1.0, 1.0, n), rng.uniform(-1.0, 1.0, d)
            values = np.array([field(t, x.copy(), q) for q in corners(d)])
            off = np.abs(np.prod(0.5 * (1.0 + corners(d) * s), axis=1) @ values - field(t, x.copy(), s))
            if not np.all(off <= 1e-12 * (1.0 + np.abs(values).max(axis=0))):
                return False
    return True


def corners(d: int) -> np.ndarray:
    """(2^d, d) signs."""
    return np.array(list(product((1.0, -1.0), repeat=d)))


def held(case: Case, X: np.ndarray, weights: np.ndarray, h: float) -> str:
    """Where a run in steps of h, with these mean weights (K - 1, d) of the positive sides between samples, stays in the corner
    of two or more surfaces whose modes are not affine in their signs; "" if nowhere.

    There the velocities of Filippov's set are many, and alternating between modes picks one that is not that of
    multilinear weights.
    """
    field, switch, d = case.problem.field(np), case.problem.switch(np), surfaces(case.problem, case.n)
    if d < 2:
        return ""
    near, values = np.zeros((len(X), d), bool), []
    with np.errstate(all="ignore"):
        for k, (t, x) in enumerate(zip(case.t, X, strict=True)):
            values.append([field(t, x.copy(), s) for s in corners(d)])
            c, steps = switch(t, x), [np.abs(switch(t + h, x + h * f) - switch(t, x)) for f in values[-1]]
            near[k] = np.abs(c) <= STEPS * np.max(steps, axis=0)
    both = near[1:] & near[:-1] & (weights > SIDE) & (weights < 1.0 - SIDE)
    for k in np.flatnonzero(both.sum(axis=1) > 1):
        rows, f = np.flatnonzero(both[k]), np.array(values[k + 1])
        fit = np.column_stack((np.ones(2**d), corners(d)))
        off = np.abs(f - fit @ np.linalg.lstsq(fit, f, rcond=None)[0]).max()
        if off > 1e-9 * np.abs(f).max():
            return (f"From t = {case.t[k]:.6g} to {case.t[k + 1]:.6g} the state stays in the corner of surfaces "
                    f"{', '.join(map(str, rows))}")
    return ""
