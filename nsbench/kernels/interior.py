"""The least-distance problem of one step for many contacts: an interior-point method on fronts, warm and polished.

    min 1/2 |d|^2  s.t.  s = q + G d >= 0        d = G^T lam,    lam >= 0,    lam_k s_k -> 0

Every round factors I + G^T diag(weight) G, which redundant contacts cannot make singular, and takes Mehrotra's predictor and
corrector and Gondzio's further correctors from it (SIAM J. Optim. 2(4), 1992; Comput. Optim. Appl. 6, 1996). It starts on the
central path next to the multipliers of the step before: lam - s = guess - w and lam s = mu, for any guess
(the smoothing of Chen & Harker, Kanzow; SIAM J. Matrix Anal. Appl. 14(4), 1993). It ends as soon as the rows with lam > s,
taken for equations and refined with the factor at hand, leave no more than `tol` of the residual of kernels.qp.residual.
"""
import numpy as np
from numba import njit

from nsbench.kernels.fronts import factor, solve
from nsbench.kernels.sparse import push, slack

ROUNDS, PATIENCE = 80, 25    # about 20 do from nothing; then ten times tol will do; then it is given up
CORRECTORS = 2               # more of them find nothing to correct
BACK = 0.999                 # of the way to the border
ENOUGH = 0.95                # a step this long needs no corrector
NEAR, COLD = 0.01, 1.0        # of the squared residual of the guess: where on the central path to start, warm or cold
CENTRAL = 0.01               # of mu: a product lam s below is lifted, by s
PROX = 1e-9                 # proximal term of the multipliers, of lengths: no weight is above its inverse
FAR = 1e9                    # a point farther away than this many scales is no point


@njit(cache=True, error_model="numpy")
def wrong(mu, w, norm):
    """The largest |min(mu_k |G_k|, w_k / |G_k|)|."""
    worst = 0.0
    for k in range(mu.size):
        v = abs(min(mu[k] * norm[k], w[k] / norm[k]))
        if not v <= worst:
            worst = v
    return worst


@njit(cache=True, error_model="numpy")
def _start(guess, w, norm, mu, lam, s):
    """The point with lam - s = guess - w (as lengths) and lam s = mu; returns lam . s."""
    for k in range(lam.size):
        v = guess[k] * norm[k] - w[k] / norm[k]
        r = np.sqrt(v * v + 4.0 * mu)
        a = 0.5 * (v + r) if v > 0.0 else 2.0 * mu / (r - v)
        lam[k], s[k] = a / norm[k], mu / a * norm[k]


@njit(cache=True, error_model="numpy")
def _direction(T, L, P, vals, lam, s, weight, rd, rp, rc, dd, ds, dl, work):
    """Newton's step for the residuals rd, rp, rc; returns how much of it keeps lam and s positive."""
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
    """Gondzio: products that a longer step would leave outside [mu / 10, 10 mu] are drawn towards it."""
    t = min(1.0, max(a + 0.2, 1.5 * a))
    for k in range(lam.size):
        v = (lam[k] + t * dl[k]) * (s[k] + t * ds[k])
        other[k] = rc[k]
        if v < 0.1 * mu:
            other[k] -= 0.1 * mu - v
        elif v > 10.0 * mu:
            other[k] -= max(10.0 * mu - v, -10.0 * mu)


@njit(cache=True, error_model="numpy")
def polish(T, L, P, vals, q, norm, lam, s, weight, tol, mu, d, w, work):
    """The rows with lam > s as equations, refined with the factor of I + G^T diag(weight) G; returns the residual."""
    e, v = np.empty(d.size), np.empty(q.size)
    for k in range(q.size):
        mu[k] = lam[k] if lam[k] * norm[k] > s[k] / norm[k] else 0.0
    push(P, vals, mu, d)
    slack(P, vals, q, d, w)
    before, now = np.inf, wrong(mu, w, norm)
    for _ in range(8):
        if not now < 0.5 * before or now <= 1e-3 * tol:
            break
        before = now
        for k in range(q.size):
            v[k] = -weight[k] * w[k] if mu[k] > 0.0 else 0.0
        push(P, vals, v, e)
        solve(T, L, e, e, work)
        slack(P, vals, w, e, v)
        for k in range(q.size):
            if mu[k] > 0.0:
                mu[k] = max(mu[k] - weight[k] * v[k], 0.0)
        push(P, vals, mu, d)
        slack(P, vals, q, d, w)
        now = wrong(mu, w, norm)
    return now


@njit(cache=True, error_model="numpy")
def _parted(q, lam, d, norm, scale):
    """Whether lam proves that there is no point within FAR scales: lam . (q + G d) < 0 for all of them."""
    value, size, far = 0.0, 0.0, 0.0
    for k in range(q.size):
        value += q[k] * lam[k]
        size = max(size, lam[k] * norm[k])
    for c in range(d.size):
        far += abs(d[c])
    return size > scale and -value > FAR * scale * far


@njit(cache=True, error_model="numpy")
def interior(P, T, room, vals, q, guess, norm, scale, tol, mu, d, w, near=NEAR):
    """Fill mu (m,), d = G^T mu (n,), w = q + G d. Returns code (0 solved, 1 infeasible, 2 neither) and rounds.

    T, room: kernels.parts.tree of the pattern and kernels.fronts.room of it; guess (m,): multipliers to start near.
    """
    m, n = q.size, d.size
    L, F, stack, work = room
    lam, s, rp, rc, other = np.empty(m), np.empty(m), np.empty(m), np.empty(m), np.empty(m)
    weight = np.empty(m)
    ds, dl, es, el = np.empty(m), np.empty(m), np.empty(m), np.empty(m)
    z, rd, dd, ed, g = np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    push(P, vals, guess, z)
    slack(P, vals, q, z, w)
    _start(guess, w, norm, max(near * wrong(guess, w, norm) ** 2, tol * tol), lam, s)
    push(P, vals, lam, z)
    for rounds in range(ROUNDS):
        push(P, vals, lam, g)
        slack(P, vals, q, z, w)
        gap, off = 0.0, 0.0
        for c in range(n):
            rd[c] = z[c] - g[c]
        for k in range(m):
            rp[k] = w[k] - s[k]
            gap += lam[k] * s[k]
            off = max(off, abs(rp[k]) / norm[k])
            weight[k] = lam[k] / (s[k] + PROX / (norm[k] * norm[k]) * lam[k])
        if not gap < np.inf:
            return 2, rounds
        if _parted(q, lam, g, norm, scale):
            return 1, rounds
        factor(T, P[0], vals, weight, L, F, stack)
        if gap < 10.0 * m * tol and off < 1e4 * tol and polish(T, L, P, vals, q, norm, lam, s, weight, tol, mu, d, w,
                                                              work) <= (tol if rounds < PATIENCE else 10.0 * tol):
            return 0, rounds + 1
        for k in range(m):
            rc[k] = lam[k] * s[k]
        a, after = _direction(T, L, P, vals, lam, s, weight, rd, rp, rc, dd, ds, dl, work), 0.0
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
    return 2, ROUNDS
