"""The order an error tends to: err = M h^p (1 + r (h / h_max)^q), a power law with one further power.

The further power matters even where nobody can see it. A line through log err is off by half the drift of its local
slope, and a drift of one standard error (never detected) is four half-widths of the line's own interval: an interval
without the further power holds h + 3 h^2 with 10 % scatter in half of all trials. So it is always in the model, at
the price of an interval about twice as wide; where scatter is small the price is too.

The shapes of the head are equal to first order in r: a sum, of either sign (the error may pass zero), and
(1 + r (h / h_max)^q)^-1 or ^-1/2, for errors that saturate at coarse steps. Each is fitted to log err by least squares;
the order is their mean, weighted by how well they fit (Buckland, Burnham & Augustin, Biometrics 53, 1997, eq. 9).
"""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

# belief in each shape of the head, (q, kind), before the data are seen: smooth expansions have q = 1, symmetric ones 2,
# grazes and corners 1/2; "sum" is 1 + r (h / h_max)^q with r of either sign, "saturated" and "root" its inverse, and
# the root of that
MODELS = {(q, kind): of_q * of_kind for q, of_q in ((1.0, 0.7), (0.5, 0.1), (2.0, 0.1), (3.0, 0.1))
          for kind, of_kind in (("sum", 0.5), ("saturated", 0.25), ("root", 0.25))}
DECAYED = 0.3                             # the same where the alternative is a plateau, which is a head of order 0
LIMIT = 1.0                               # largest share of the head at the finest step that is tried; more is no limit
EDGE = 0.5                                # share above which the order is a guess: "pre-asymptotic"
COUNTED = 0.5                             # of the scatter of the orders about their mean: about half of it is noise, which
                                          # the variance of the mean holds already
MOST = 9.0                                # variance of a slope under a correlation of 0.8 over that under none
EPS = float(np.finfo(float).eps)


@dataclass(frozen=True)
class Headed:
    """log err = a + p u + head(u), u = log(h / h_max). half: half-width of the 95 % interval of p (t-based, widened by
    the correlation of neighbouring residuals); head (n,): the fitted head; rss; freedom: n - 3; q, r: of the head;
    edge: the head has not decayed at the finest step, in models with most of the weight; bend, drift: |t| of a
    further square of u and the change of slope over the window it means; inflation: of the variance, by correlation."""
    a: float
    p: float
    half: float
    head: np.ndarray
    rss: float
    freedom: int
    q: float
    r: float
    edge: bool
    bend: float
    drift: float
    inflation: float


def fit_headed(u: np.ndarray, y: np.ndarray) -> Headed:
    """Least squares over r for each q and shape (grid, then Gauss-Newton). u (n,) ascending, n >= 5."""
    from scipy.special import stdtrit
    u = u - u.max()
    n = len(u)
    Q, _ = np.linalg.qr(np.stack([np.ones(n), u], 1))
    fits = [_with_head(u, y, Q, q, kind, LIMIT) for q, kind in MODELS]
    rss = np.array([f[0] for f in fits])
    rss = np.maximum(rss, n * (8 * EPS) ** 2)                # rounding of the logarithms is no misfit
    best = int(np.argmin(rss))
    _, q, r, head, J, a, p = fits[best]
    resid = y - head - a - p * u
    grow = _inflation(resid)
    s2 = rss[best] / max(n - 3, 1)
    belief, worse = np.array(list(MODELS.values())), (rss - rss[best]) / s2
    weight = belief * np.exp(-0.5 * worse / grow)
    weight /= weight.sum()
    mean = float(weight @ [f[-1] for f in fits])
    # every order is linear in log err nearby, so the mean is too; to its variance comes that of the orders about it
    reader = weight @ [np.linalg.pinv(f[4])[1] for f in fits]
    apart = float(weight @ [(f[-1] - mean) ** 2 for f in fits])
    half = float(stdtrit(n - 3, 0.975)) * np.sqrt(s2 * grow * float(reader @ reader) + COUNTED * apart) if n > 3 else np.inf
    # residuals as smooth as the estimate can say are no noise but misfit, and a bend in them counts in full
    bend, drift = _bend(u, J, resid, s2 * (grow if grow < MOST else 1.0))
    share = np.array([abs(f[2]) * np.exp(f[1] * u[0]) for f in fits])
    sharp = belief * np.exp(-0.5 * worse)                    # a smooth misfit inflates the variance, but not the doubt
    edge = bool(sharp @ (share > EDGE) > 0.5 * sharp.sum())
    return Headed(a + (p - mean) * float(u[0]), mean, half, head, float(rss[best]), n - 3, q, r, edge, bend, drift, grow)


def _with_head(u, y, Q, q, kind, most):
    """Best fit with one shape of head: (rss, q, r, head, Jacobian in (a, p, r), a, p)."""
    e = np.exp(q * u)
    rss, r = _along(Q, e, y, kind, most)
    head, slope = _head(r, e, kind)
    J = np.stack([np.ones(len(u)), u, slope / max(np.abs(slope).max(), 1e-300)], 1)
    (a, p), *_ = np.linalg.lstsq(J[:, :2], y - head, rcond=None)
    return rss, q, r, head, J, float(a), float(p)


def convergent(u: np.ndarray, y: np.ndarray, least: float) -> float:
    """The smallest sum of squares of a power law with a head whose order is at least `least`."""
    u = u - u.max()
    n, w = len(u), u - u.mean()
    Q, _ = np.linalg.qr(np.stack([np.ones(n), u], 1))
    best = np.inf
    for q, kind in MODELS:
        rss, *_, p = _with_head(u, y, Q, q, kind, DECAYED)
        if p < least:                                        # on the edge: a grid over r with p = least
            grid = _grid(np.exp(q * u[0]), kind, DECAYED)
            z = y[:, None] - _head(grid[None, :], np.exp(q * u)[:, None], kind)[0] - least * w[:, None]
            rss = float((z - z.mean(0)).T.var(1).min()) * n
        best = min(best, rss)
    return max(best, n * (8 * EPS) ** 2)


def _head(r, e, kind):
    """(head, its derivative in r) for r scalar or (1, m) and e (n,) or (n, 1)."""
    if kind != "sum":
        power = {"saturated": 1.0, "root": 0.5}[kind]
        return -power * np.log1p(r * e), -power * e / (1 + r * e)
    z = 1 + r * e
    z = np.where(np.abs(z) < 1e-3, 1e-3, z)                  # a step at which both terms cancel says nothing finer
    return np.log(np.abs(z)), e / z


def _grid(finest, kind, most):
    """Values of r for which the head has decayed at the finest step, where (h / h_max)^q = finest."""
    size = np.geomspace(1e-3, max(most / finest, 2e-3), 40)
    return np.concatenate([-(size if kind == "sum" else size[size < 0.9])[::-1], [0.0], size])


def _along(Q, e, y, kind, most):
    """The best r of one shape: (rss, r)."""
    grid = _grid(e[0], kind, most)

    def misfit(r):
        z = y[:, None] - _head(r[None, :], e[:, None], kind)[0]
        z = z - Q @ (Q.T @ z)
        return np.einsum("ij,ij->j", z, z)
    rss = misfit(grid)
    k = int(np.argmin(rss))
    low, high = grid[0], grid[-1]
    r, best = float(grid[k]), float(rss[k])
    for _ in range(12):
        head, slope = _head(r, e, kind)
        z, d = y - head, slope - Q @ (Q.T @ slope)
        z = z - Q @ (Q.T @ z)
        dd = float(d @ d)
        if dd <= 1e-24:
            break
        trial = np.clip(r + float(d @ z) / dd * np.array([1.0, 0.5, 0.1]), low, high)
        rss = misfit(trial)
        k = int(np.argmin(rss))
        if rss[k] >= best * (1 - 1e-9):
            break
        r, best = float(trial[k]), float(rss[k])
    return best, r


def _inflation(resid: np.ndarray) -> float:
    """How much the variance of a slope grows with the correlation rho of neighbouring residuals: (1 + rho) / (1 - rho).

    rho is corrected for the bias of its estimate with three fitted parameters; never below 1 (negative correlation is
    not trusted to help), nor above MOST.
    """
    n, norm = len(resid), float(resid @ resid)
    if n < 8 or norm == 0.0:
        return 1.0
    rho = float(resid[1:] @ resid[:-1]) / norm
    rho = max((rho * n + 2.0) / max(n - 4.0, 1.0), 0.0)
    return min((1 + rho) / (1 - rho), MOST) if rho < 1.0 else MOST


def _bend(u, J, resid, s2):
    """|t| of a square of u that the model leaves over, and the change of the local slope over the window it means."""
    if len(u) < 6:
        return 0.0, 0.0
    v = (u - u.mean()) / (u[-1] - u[0])
    w = v * v
    w = w - J @ np.linalg.lstsq(J, w, rcond=None)[0]
    ww = float(w @ w)
    if ww <= 1e-12:
        return 0.0, 0.0
    c = float(w @ resid) / ww
    rest = max((s2 * (len(u) - 3) - c * c * ww) / max(len(u) - 4, 1), 1e-3 * s2)
    return abs(c) * np.sqrt(ww / rest), 2.0 * c / (u[-1] - u[0])
