"""The least-distance problem of one step for many contacts: an interior-point method on fronts,
finished by an active set.

    min 1/2 |d|^2  s.t.  s = q + G d >= 0        d = G^T lam,    lam >= 0,    lam_k s_k -> 0

Every round factors I + G^T diag(weight) G, which redundant contacts cannot make singular, and takes
Mehrotra's predictor and corrector and Gondzio's further correctors from it (SIAM J. Optim. 2(4),
1992; Comput. Optim. Appl. 6, 1996). It starts on the central path next to the multipliers of the
step before: lam - s = guess - w and lam s = mu, for any guess (the smoothing of Chen & Harker,
Kanzow; SIAM J. Matrix Anal. Appl. 14(4), 1993). As soon as few rows are left of which it is not
clear whether they act, kernels.revise finishes from the rows with lam > s. Rows of G have length 1.
"""

import numpy as np

from nsbench.compilation.decorators import njit
from nsbench.linalg.multifrontal import factor, solve
from nsbench.linalg.sparse_ldl import push, slack
from nsbench.qp.kernels.working_set_update import update_working_set

ROUNDS = 80  # about 20 do from nothing
CORRECTORS = 2  # more of them find nothing to correct
BACK = 0.999  # of the way to the border
ENOUGH = 0.95  # a step this long needs no corrector
# of the squared residual of the guess: where on the central path to start, warm or cold
NEAR = 0.01
COLD = 1.0
CENTRAL = 0.01  # of mu: a product lam s below is lifted, by s
# lam / s of a row that is clear; SMALL and so few others among all are worth an attempt to finish
CLEAR = 1e3
OPEN = 0.005
SMALL = 100  # an exchange costs a tenth of a round, whatever the size
# of tol, mean product lam s: nothing more becomes clear after that, many rows are neither
LATE = 1e-2
# exchanges in that attempt; it is not begun with more signs wrong than rows may be unclear
SWAPS = 300
PROX = 1e-9  # proximal term of the multipliers, of lengths: no weight is above its inverse
FAR = 1e9  # a point farther away than this many scales is no point


@njit(cache=True, error_model="numpy")
def wrong(mu, w):
    """The largest |min(mu_k, w_k)|."""
    worst = 0.0
    for k in range(mu.size):
        v = abs(min(mu[k], w[k]))
        if not v <= worst:
            worst = v
    return worst


@njit(cache=True, error_model="numpy")
def _start(guess, w, mu, lam, s):
    """The point with lam - s = guess - w and lam s = mu; returns lam . s."""
    for k in range(lam.size):
        v = guess[k] - w[k]
        r = np.sqrt(v * v + 4.0 * mu)
        a = 0.5 * (v + r) if v > 0.0 else 2.0 * mu / (r - v)
        lam[k] = a
        s[k] = mu / a


@njit(cache=True, error_model="numpy")
def _direction(T, L, P, vals, lam, s, weight, rd, rp, rc, dd, ds, dl, work):
    """Newton's step for the residuals rd, rp, rc; returns how much of it keeps lam and s
    positive."""
    for k in range(lam.size):
        dl[k] = weight[k] * (rp[k] + rc[k] / lam[k])
    push(P, vals, dl, dd)
    for c in range(dd.size):
        dd[c] = -rd[c] - dd[c]
    solve(T, L, dd, dd, work)
    slack(P, vals, rp, dd, ds)
    shrink = 1.0
    for k in range(lam.size):
        dl[k] = -weight[k] * (rc[k] / lam[k] + ds[k])
        ds[k] = (-rc[k] - s[k] * dl[k]) / lam[k]
        shrink = max(shrink, max(-ds[k] / s[k], -dl[k] / lam[k]))
    return 1.0 / shrink


@njit(cache=True, error_model="numpy")
def _further(lam, s, ds, dl, a, mu, rc, other):
    """Gondzio: products that a longer step would leave outside [mu / 10, 10 mu] are drawn towards
    it."""
    t = min(1.0, max(a + 0.2, 1.5 * a))
    for k in range(lam.size):
        v = (lam[k] + t * dl[k]) * (s[k] + t * ds[k])
        other[k] = rc[k]
        if v < 0.1 * mu:
            other[k] -= 0.1 * mu - v
        elif v > 10.0 * mu:
            other[k] -= max(10.0 * mu - v, -10.0 * mu)


@njit(cache=True, error_model="numpy")
def _open(lam, s):
    """Rows of which it is not clear yet whether they act."""
    count = 0
    for k in range(lam.size):
        count += lam[k] < CLEAR * s[k] and s[k] < CLEAR * lam[k]
    return count


@njit(cache=True, error_model="numpy")
def _parted(q, lam, d, scale):
    """Whether lam proves that there is no point within FAR scales: lam . (q + G d) < 0 for all of
    them."""
    value = 0.0
    size = 0.0
    far = 0.0
    for k in range(q.size):
        value += q[k] * lam[k]
        size = max(size, lam[k])
    for c in range(d.size):
        far += abs(d[c])
    return size > scale and -value > FAR * scale * far


@njit(cache=True, error_model="numpy")
def interior(P, T, room, vals, q, guess, scale, tol, mu, d, w, near=NEAR):
    """Fill mu (m,), d = G^T mu (n,), w = q + G d. Returns code (0 solved, 1 infeasible, 2 neither)
    and rounds.

    T, room: kernels.parts.tree of the pattern and kernels.fronts.room of it; guess (m,):
    multipliers to start near.
    """
    m = q.size
    n = d.size
    L, F, stack, work = room
    lam = np.empty(m)
    s = np.empty(m)
    rp = np.empty(m)
    rc = np.empty(m)
    other = np.empty(m)
    weight = np.empty(m)
    ds = np.empty(m)
    dl = np.empty(m)
    es = np.empty(m)
    el = np.empty(m)
    z = np.empty(n)
    rd = np.empty(n)
    dd = np.empty(n)
    ed = np.empty(n)
    g = np.empty(n)
    push(P, vals, guess, z)
    slack(P, vals, q, z, w)
    _start(guess, w, max(near * wrong(guess, w) ** 2, tol * tol), lam, s)
    push(P, vals, lam, z)
    few = SMALL + int(OPEN * m)
    late = 10.0 * LATE * m * tol
    tries = 0
    tried = 2 * few
    for rounds in range(ROUNDS):
        push(P, vals, lam, g)
        slack(P, vals, q, z, w)
        gap = 0.0
        off = 0.0
        for c in range(n):
            rd[c] = z[c] - g[c]
        for k in range(m):
            rp[k] = w[k] - s[k]
            gap += lam[k] * s[k]
            off = max(off, abs(rp[k]))
            weight[k] = lam[k] / (s[k] + PROX * lam[k])
        if not gap < np.inf:
            return 2, rounds + tries
        if _parted(q, lam, g, scale):
            return 1, rounds + tries
        doubt = _open(lam, s)
        if (
            2 * doubt <= tried or gap < 0.1 * late
        ):  # an attempt costs about a round: not in every one
            tried = min(tried, doubt)
            late = min(gap, late)
            for k in range(m):
                mu[k] = lam[k] if lam[k] > s[k] else 0.0
            done, more, swaps = update_working_set(
                P, T, room, vals, q, mu, tol, few, np.int64(SWAPS), d, w
            )
            tries += more + swaps
            if done:
                return 0, rounds + tries
        factor(T, P[0], vals, weight, L, F, stack)
        for k in range(m):
            rc[k] = lam[k] * s[k]
        a = _direction(T, L, P, vals, lam, s, weight, rd, rp, rc, dd, ds, dl, work)
        after = 0.0
        for k in range(m):
            after += (lam[k] + a * dl[k]) * (s[k] + a * ds[k])
        goal = gap / m * (after / gap) ** 3
        for k in range(m):
            rc[k] += ds[k] * dl[k] - goal
        a = _direction(T, L, P, vals, lam, s, weight, rd, rp, rc, dd, ds, dl, work)
        for _ in range(CORRECTORS):
            if a > ENOUGH:
                break
            _further(lam, s, ds, dl, a, goal, rc, other)
            b = _direction(T, L, P, vals, lam, s, weight, rd, rp, other, ed, es, el, work)
            if b < 1.05 * a:
                break
            a, dd, ed, ds, es, dl, el, rc, other = b, ed, dd, es, ds, el, dl, other, rc
        a = BACK * a if a < 1.0 else 1.0
        for c in range(n):
            z[c] += a * dd[c]
        after = 0.0
        for k in range(m):
            s[k] += a * ds[k]
            lam[k] += a * dl[k]
            after += lam[k] * s[k]
        for k in range(m):
            s[k] = max(s[k], CENTRAL * after / m / lam[k])
    return 2, ROUNDS + tries
