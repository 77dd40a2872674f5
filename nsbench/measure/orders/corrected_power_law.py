"""Order an error tends to: err = M h^p (1 + r (h / h_max)^q), with one further power.

The further power matters even where nobody can see it. A line through log err is off by half the
drift of its local slope, and a drift of one standard error (never detected) is four half-widths of
the line's own interval: an interval without the further power holds h + 3 h^2 with 10 % scatter in
half of all trials. So it is always in the model, at the price of an interval about twice as wide;
where scatter is small the price is too.

The shapes of the head are equal to first order in r: a sum, of either sign (the error may pass
zero), and (1 + r (h / h_max)^q)^-1 or ^(-1/2), for errors that saturate at coarse steps. Each is
fitted to log err by least squares; the order is their mean, weighted by how well they fit
(Buckland, Burnham & Augustin, Biometrics 53, 1997, eq. 9).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

# belief in each shape of the head, (q, power), before the data are seen. Smooth expansions have q =
# 1, symmetric ones 2, grazes and corners 1/2; the head is (1 + r (h / h_max)^q)^power with r of
# either sign
MODELS = {
    (q, power): of_q * of_power
    for q, of_q in ((1.0, 0.7), (0.5, 0.1), (2.0, 0.1), (3.0, 0.1))
    for power, of_power in ((1.0, 0.5), (-1.0, 0.25), (-0.5, 0.25))
}
Q, POWER = (np.array(column)[:, None] for column in zip(*MODELS, strict=True))
BELIEF = np.array(list(MODELS.values()))
DECAYED = 0.3  # the same where the alternative is a plateau, which is a head of order 0
LIMIT = 1.0  # largest share of the head at the finest step that is tried; more is no limit
GAP = 0.1  # between p and the local slope at the finest step: more is a guess
MOST = 9.0  # variance of a slope under a correlation of 0.8 over that under none
EPS = float(np.finfo(float).eps)


@dataclass(frozen=True)
class CorrectedPowerLaw:
    """Fit of log err = a + p u + head(u), u = log(h / h_max), to n points.

    half: half-width of the 95 % interval of p (t-based, widened by the correlation of neighbouring
    residuals); head (n,): the fitted head; rss; freedom: n - 3; q, r: of the head; edge: the slope
    at the finest step is not p yet, in models with most of the weight; bend, drift: |t| of a
    further square of u and the change of slope over the window it means; inflation: of the
    variance, by correlation.
    """

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


def fit_corrected(u: np.ndarray, y: np.ndarray, own: np.ndarray | float = 0.0) -> CorrectedPowerLaw:
    """Fit a power law with a head by least squares over r for each shape of the head.

    A grid of r, then Gauss-Newton. u (n,): log h but for a constant, ascending, n >= 5; y (n,): log
    err. own (n,): how far the reference's own error, relative to err, may have moved each y: it
    widens the interval.
    """
    own = np.broadcast_to(own, u.shape)
    from scipy.special import stdtrit

    u, n = u - u.max(), len(u)
    rss, r, p, reader = _fits(u, y, LIMIT)
    rss = np.maximum(rss, n * (8 * EPS) ** 2)  # rounding of the logarithms is no misfit
    best = int(np.argmin(rss))
    head, slope = _head(r, np.exp(Q * u))
    rest = y - head[best] - p[best] * u
    a = float(rest.mean())
    resid = rest - rest.mean()
    grow = _inflation(resid)
    s2 = rss[best] / max(n - 3, 1)
    worse = (rss - rss[best]) / s2
    weight = BELIEF * np.exp(-0.5 * worse / grow)
    weight /= weight.sum()
    mean = float(weight @ p)
    # every order is linear in log err nearby, so the mean is too; to its variance comes that of the
    # orders about it
    by = weight @ reader
    half = float(stdtrit(n - 3, 0.975)) * np.sqrt(
        s2 * grow * (by @ by) + weight @ (p - mean) ** 2 + (by * by) @ own**2
    )
    # residuals as smooth as the estimate can say are no noise but misfit, and a bend in them counts
    # in full
    J = np.stack([np.ones(n), u, slope[best] / max(np.abs(slope[best]).max(), 1e-300)], 1)
    bend, drift = _bend(u, J, resid, s2 * (grow if grow < MOST else 1.0))
    sharp = BELIEF * np.exp(
        -0.5 * worse
    )  # a smooth misfit inflates the variance, but not the doubt
    share = r * np.exp(Q[:, 0] * u[0])
    gap = np.abs(POWER[:, 0] * Q[:, 0] * share) / np.maximum(np.abs(1 + share), 1e-3)
    edge = bool(sharp @ (gap > GAP) > 0.5 * sharp.sum())
    return CorrectedPowerLaw(
        a + (p[best] - mean) * float(u[0]),
        mean,
        float(half),
        head[best],
        float(rss[best]),
        n - 3,
        float(Q[best, 0]),
        float(r[best]),
        edge,
        float(bend),
        float(drift),
        grow,
    )


def convergent(u: np.ndarray, y: np.ndarray, least: float) -> float:
    """Return the least sum of squares of a power law with a head; u, y (k,): logarithms of steps
    and errors.

    Its order is at least `least`.
    """
    u, n = u - u.max(), len(u)
    rss, _, p, _ = _fits(u, y, DECAYED)
    grid = _grid(np.exp(Q * u[0]), DECAYED)  # on the edge: a grid over r with p = least
    z = y - least * u - _head(grid, np.exp(Q * u))[0]
    edge = z.var(axis=-1).min(axis=-1) * n
    return max(float(np.where(p < least, edge, rss).min()), n * (8 * EPS) ** 2)


def _head(r, e):
    """Return the head and its derivative in r.

    r (models, ...), e (models, n): results (models, ..., n).
    """
    shape = (len(e),) + (1,) * (r.ndim - 1) + (-1,)
    e = e.reshape(shape)
    power = POWER.reshape(shape)
    z = 1 + r[..., None] * e
    z = np.where(np.abs(z) < 1e-3, 1e-3, z)  # a step at which both terms cancel says nothing finer
    return power * np.log(np.abs(z)), power * e / z


def _grid(finest, most):
    """Return (models, 61) values of r whose share at the finest step is at most `most`.

    There (h / h_max)^q = finest (models, 1). Below -0.9 only for a sum, whose error may pass zero.
    """
    top = np.maximum(most / finest, 2e-3)
    unit = np.linspace(0.0, 1.0, 30)
    up = 1e-3 * (top / 1e-3) ** unit
    down = -1e-3 * (np.where(POWER > 0, top, np.minimum(top, 0.9)) / 1e-3) ** unit
    return np.concatenate([down[:, ::-1], np.zeros_like(top), up], 1)


def _fits(u, y, most):
    """Fit every model; return (rss, r, p, v).

    v: the vector whose product with log err is p to first order.
    """
    e = np.exp(Q * u)
    w = u - u.mean()
    w = w / np.sqrt(w @ w)

    def off(z: np.ndarray) -> np.ndarray:
        z = z - z.mean(axis=-1, keepdims=True)
        return z - (z @ w)[..., None] * w

    grid = _grid(e[:, :1], most)
    z = off(y - _head(grid, e)[0])
    rss = np.einsum("...i,...i", z, z)
    rows = np.arange(len(e))
    at = rss.argmin(1)
    r = grid[rows, at]
    best = rss[rows, at]
    low = grid[:, 0]
    high = grid[:, -1]
    for _ in range(15):
        head, slope = _head(r, e)
        z = off(y - head)
        d = off(slope)
        dd = np.einsum("ij,ij->i", d, d)
        step = np.where(dd > 1e-24, np.einsum("ij,ij->i", d, z) / np.maximum(dd, 1e-24), 0.0)
        trial = np.clip(
            r[:, None] + step[:, None] * np.array([1.0, 0.5, 0.1]), low[:, None], high[:, None]
        )
        z = off(y - _head(trial, e)[0])
        rss = np.einsum("...i,...i", z, z)
        at = rss.argmin(1)
        better = rss[rows, at] < best * (1 - 1e-9)
        r = np.where(better, trial[rows, at], r)
        best = np.where(better, rss[rows, at], best)
        if not better.any():
            break
    head, slope = _head(r, e)
    c = u - u.mean()
    p = (y - head) @ c / (c @ c)
    d = slope - slope.mean(axis=1, keepdims=True)
    dd = np.maximum(np.einsum("ij,ij->i", d, d), 1e-300)
    v = c - d * (d @ c / dd)[:, None]  # the part of u that neither constant nor head can make
    return best, r, p, v / np.maximum(np.einsum("ij,ij->i", v, v), 1e-300)[:, None]


def _inflation(resid: np.ndarray) -> float:
    """Estimate the growth of a slope's variance by correlated residuals: (1 + rho) / (1 - rho).

    rho, the correlation of neighbouring residuals, is corrected for the bias of its estimate with
    three fitted parameters; the factor is never below 1 (negative correlation is not trusted to
    help), nor above MOST.
    """
    n = len(resid)
    norm = float(resid @ resid)
    if n < 8 or norm == 0.0:
        return 1.0
    rho = float(resid[1:] @ resid[:-1]) / norm
    rho = max((rho * n + 2.0) / max(n - 4.0, 1.0), 0.0)
    return min((1 + rho) / (1 - rho), MOST) if rho < 1.0 else MOST


def _bend(u, J, resid, s2):
    """Test for a square of u that the model leaves over.

    Returns its |t| and the change of the local slope over the window it means.
    """
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
