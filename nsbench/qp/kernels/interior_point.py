"""Primal-dual interior-point method for a large projection QP, finished by a working set.

    min 1/2 |d|^2  s.t.  s = q + G d >= 0        d = G^T lam,    lam >= 0,    lam_k s_k -> 0

Every iteration factors I + G^T diag(weight) G (linalg.multifrontal), which redundant contacts
cannot make singular, and takes Mehrotra's predictor and corrector and Gondzio's further correctors
from it (SIAM J. Optim. 2(4), 1992; Comput. Optim. Appl. 6, 1996). It starts on the central path
next to the multipliers of the step before: lam - s = guess - w and lam s = mu, for any guess (the
smoothing of Chen & Harker, Kanzow; SIAM J. Matrix Anal. Appl. 14(4), 1993). As soon as few rows are
left of which it is not clear whether they are active, kernels.working_set_update finishes from the
rows with lam > s. Rows of G have length 1.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from nsbench.compilation.decorators import inner_kernel
from nsbench.linalg.multifrontal import factor, solve
from nsbench.linalg.sparse_ldl import push, slack
from nsbench.qp.kernels.working_set_update import update_working_set

if TYPE_CHECKING:
    from nsbench.linalg.nested_dissection import AssemblyTree
    from nsbench.linalg.sparse_ldl import SparsityPattern

MAX_ITERATIONS = 80  # about 20 are enough from a cold start
CORRECTORS = 2  # more of them find nothing to correct
TO_BOUNDARY = 0.999  # part of the largest step that keeps lam and s positive
LONG_STEP = 0.95  # a step this long needs no corrector
# of the squared residual of the guess: where on the central path to start, warm or cold
WARM_START = 0.01
COLD_START = 1.0
CENTRAL = 0.01  # of mu: a product lam s below is lifted, by s
# lam / s of a row that is clearly active, or of one that clearly is not; an attempt to finish is
# worth its cost with so many rows undecided, and this part of all
CLEAR = 1e3
UNDECIDED_ROWS = 100  # an exchange costs a tenth of an iteration, whatever the size
UNDECIDED_PART = 0.005
# of tol, mean product lam s: below it nothing more becomes clear, many rows are neither
LATE = 1e-2
# exchanges in that attempt; it is not begun with more signs wrong than rows may be undecided
MAX_EXCHANGES = 300
PROX = 1e-9  # proximal term of the multipliers, of lengths: no weight is above its inverse
INFINITE_DISTANCE = 1e9  # scales: there is no feasible point if none is this near

# results of `interior_point`
CONVERGED = 0
INFEASIBLE = 1
UNDECIDED = 2


class Direction(NamedTuple):
    """Steps of the primal point (n,), of the slacks s (m,) and of the multipliers lam (m,)."""

    point: np.ndarray
    s: np.ndarray
    lam: np.ndarray


class Residuals(NamedTuple):
    """rd (n,): of d = G^T lam; rp (m,): of s = q + G d; rc (m,): of lam s = mu; corrected (m,):
    work."""

    rd: np.ndarray
    rp: np.ndarray
    rc: np.ndarray
    corrected: np.ndarray


@inner_kernel
def wrong(mu: np.ndarray, w: np.ndarray) -> float:
    """Return the largest |min(mu_k, w_k)| of mu, w (m,)."""
    worst = 0.0
    for k in range(mu.size):
        v = abs(min(mu[k], w[k]))
        if not v <= worst:
            worst = v
    return worst


@inner_kernel
def _start(guess, w, mu, lam, s):
    """Fill lam and s with the point lam - s = guess - w, lam s = mu."""
    for k in range(lam.size):
        v = guess[k] - w[k]
        r = np.sqrt(v * v + 4.0 * mu)
        a = 0.5 * (v + r) if v > 0.0 else 2.0 * mu / (r - v)
        lam[k] = a
        s[k] = mu / a


@inner_kernel
def _newton_direction(T, room, P, vals, lam, s, weight, residuals, rc, direction):
    """Fill `direction` with Newton's step for the residuals, rc those of the products lam s;
    returns how much of it keeps lam and s positive."""
    dd = direction.point
    ds = direction.s
    dl = direction.lam
    rd = residuals.rd
    rp = residuals.rp
    for k in range(lam.size):
        dl[k] = weight[k] * (rp[k] + rc[k] / lam[k])
    push(P, vals, dl, dd)
    for c in range(dd.size):
        dd[c] = -rd[c] - dd[c]
    solve(T, room.L, dd, dd, room.work)
    slack(P, vals, rp, dd, ds)
    shrink = 1.0
    for k in range(lam.size):
        dl[k] = -weight[k] * (rc[k] / lam[k] + ds[k])
        ds[k] = (-rc[k] - s[k] * dl[k]) / lam[k]
        shrink = max(shrink, max(-ds[k] / s[k], -dl[k] / lam[k]))
    return 1.0 / shrink


@inner_kernel
def _correct_outliers(lam, s, direction, a, mu, rc, other):
    """Fill `other` with rc corrected after Gondzio: products that a longer step would leave outside
    [mu / 10, 10 mu] are drawn towards it."""
    ds = direction.s
    dl = direction.lam
    t = min(1.0, max(a + 0.2, 1.5 * a))
    for k in range(lam.size):
        v = (lam[k] + t * dl[k]) * (s[k] + t * ds[k])
        other[k] = rc[k]
        if v < 0.1 * mu:
            other[k] -= 0.1 * mu - v
        elif v > 10.0 * mu:
            other[k] -= max(10.0 * mu - v, -10.0 * mu)


@inner_kernel
def _count_undecided(lam, s):
    """Count the rows of which it is not clear yet whether they are active."""
    count = 0
    for k in range(lam.size):
        count += lam[k] < CLEAR * s[k] and s[k] < CLEAR * lam[k]
    return count


@inner_kernel
def _proves_infeasible(q, lam, d, scale):
    """Does lam prove that there is no feasible point within INFINITE_DISTANCE scales: lam . (q +
    G d) < 0 for all of them?"""
    value = 0.0
    size = 0.0
    far = 0.0
    for k in range(q.size):
        value += q[k] * lam[k]
        size = max(size, lam[k])
    for c in range(d.size):
        far += abs(d[c])
    return size > scale and -value > INFINITE_DISTANCE * scale * far


@inner_kernel
def _search_direction(T, room, P, vals, lam, s, weight, residuals, gap, first, second):
    """Mehrotra's predictor and corrector, and Gondzio's further correctors, on one factor.

    first, second: directions to work in. Returns how much of the step keeps lam and s positive, and
    the direction.
    """
    m = lam.size
    rc = residuals.rc
    other = residuals.corrected
    factor(T, P.ptr, vals, weight, room.L, room.F, room.stack)
    for k in range(m):
        rc[k] = lam[k] * s[k]
    step = first
    trial = second
    # predictor: towards lam s = 0
    a = _newton_direction(T, room, P, vals, lam, s, weight, residuals, rc, step)
    after = 0.0
    for k in range(m):
        after += (lam[k] + a * step.lam[k]) * (s[k] + a * step.s[k])
    goal = gap / m * (after / gap) ** 3
    # corrector: towards the central path, with the predictor's second-order term
    for k in range(m):
        rc[k] += step.s[k] * step.lam[k] - goal
    a = _newton_direction(T, room, P, vals, lam, s, weight, residuals, rc, step)
    for _ in range(CORRECTORS):
        if a > LONG_STEP:
            break
        _correct_outliers(lam, s, step, a, goal, rc, other)
        b = _newton_direction(T, room, P, vals, lam, s, weight, residuals, other, trial)
        if b < 1.05 * a:
            break
        a = b
        step, trial = trial, step
        rc, other = other, rc
    return a, step


@inner_kernel
def _take_step(a, direction, z, s, lam):
    """Go the part a of a direction; products lam s far below their mean are lifted."""
    m = lam.size
    a = TO_BOUNDARY * a if a < 1.0 else 1.0
    for c in range(z.size):
        z[c] += a * direction.point[c]
    after = 0.0
    for k in range(m):
        s[k] += a * direction.s[k]
        lam[k] += a * direction.lam[k]
        after += lam[k] * s[k]
    for k in range(m):
        s[k] = max(s[k], CENTRAL * after / m / lam[k])


@inner_kernel
def _fill_residuals(z, g, w, lam, s, residuals, weight):
    """Fill the residuals of d = G^T lam and s = q + G d at the point z, and the weights; g = G^T
    lam, w = q + G z. Returns lam . s."""
    gap = 0.0
    for c in range(z.size):
        residuals.rd[c] = z[c] - g[c]
    for k in range(lam.size):
        residuals.rp[k] = w[k] - s[k]
        gap += lam[k] * s[k]
        weight[k] = lam[k] / (s[k] + PROX * lam[k])
    return gap


@inner_kernel
def interior_point(
    P: SparsityPattern, T: AssemblyTree, room, vals, q, guess, scale, tol, mu, d, w, near=WARM_START
) -> tuple[int, int]:
    """Solve the projection QP: fill mu (m,), d = G^T mu (n,), w = q + G d.

    P, T, room: SparsityPattern, AssemblyTree and FrontWorkspace of G; vals: entries of G; guess
    (m,): multipliers to start near; scale: size of the numbers the gaps are made of; tol: residual
    that counts as solved. Returns CONVERGED, INFEASIBLE or UNDECIDED, and iterations.
    """
    m = q.size
    n = d.size
    lam = np.empty(m)
    s = np.empty(m)
    weight = np.empty(m)
    z = np.empty(n)
    g = np.empty(n)
    residuals = Residuals(np.empty(n), np.empty(m), np.empty(m), np.empty(m))
    first = Direction(np.empty(n), np.empty(m), np.empty(m))
    second = Direction(np.empty(n), np.empty(m), np.empty(m))
    push(P, vals, guess, z)
    slack(P, vals, q, z, w)
    _start(guess, w, max(near * wrong(guess, w) ** 2, tol * tol), lam, s)
    push(P, vals, lam, z)
    few = UNDECIDED_ROWS + int(UNDECIDED_PART * m)
    late = 10.0 * LATE * m * tol
    tries = 0
    tried = 2 * few
    # Mehrotra's predictor-corrector method
    for rounds in range(MAX_ITERATIONS):
        push(P, vals, lam, g)
        slack(P, vals, q, z, w)
        gap = _fill_residuals(z, g, w, lam, s, residuals, weight)
        if not gap < np.inf:
            return UNDECIDED, rounds + tries
        if _proves_infeasible(q, lam, g, scale):
            return INFEASIBLE, rounds + tries
        undecided = _count_undecided(lam, s)
        # an attempt to finish costs about an iteration: not in every one
        if 2 * undecided <= tried or gap < 0.1 * late:
            tried = min(tried, undecided)
            late = min(gap, late)
            for k in range(m):
                mu[k] = lam[k] if lam[k] > s[k] else 0.0
            done, more, swaps = update_working_set(
                P, T, room, vals, q, mu, tol, few, np.int64(MAX_EXCHANGES), d, w
            )
            tries += more + swaps
            if done:
                return CONVERGED, rounds + tries
        a, step = _search_direction(T, room, P, vals, lam, s, weight, residuals, gap, first, second)
        _take_step(a, step, z, s, lam)
    return UNDECIDED, MAX_ITERATIONS + tries
