"""Test whether an error levels off: err = C + M h^p with C > 0 against the power law C = 0.

Both models are fitted to log err by least squares; the noise level is estimated, so the likelihood
ratio of the two is the F ratio (RSS0 - RSS1) / (RSS1 / (n - 3)), compared with F(1, n - 3) at
0.1 % (conservative: C >= 0 sits on the boundary of its range under C = 0). At 1 % scatter that is
not normal was enough for a plateau: errors of stick and slip, which turn with the phase of the
step, happen to lie level at the fine end of a few ladders in a thousand.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nsbench.measure.orders.corrected_power_law import convergent, fit_corrected

LEVEL = 0.001  # of the likelihood ratio
FINER = 4.0  # a plateau must persist when the smallest step is divided by this
LARGE = 2.0  # C over M h^p at the finest step: what an order must exclude at 5 %
RISEN = 0.1  # in log err: a rise of the finest errors over the smallest that is none
SLOWEST = 0.3  # the slowest convergence a plateau is weighed against (none known is below 1/2)
CREEPING = 0.05  # an order below which nobody could tell it from none
END = 2.0**1.5  # the fine end, where the error must have stopped to fall


@dataclass(frozen=True)
class PlateauFit:
    """Fit of err = C + M h^p to n points.

    rss, rss0: sums of squares in log err with C >= 0 and with C = 0.
    """

    C: float
    M: float
    p: float
    rss: float
    rss0: float
    n: int

    @property
    def ratio(self) -> float:
        """Return the F ratio; 0 without degrees of freedom."""
        gain = self.rss0 - self.rss
        if self.n <= 3 or gain <= 0.0:
            return 0.0
        # squares of log err below (8 eps)^2 per point are rounding of the logarithms, not misfit
        return gain / max(self.rss / (self.n - 3), self.n * (8 * np.finfo(float).eps) ** 2)

    @property
    def significant(self) -> bool:
        """Is C > 0 significant against the power law, at the level LEVEL?"""
        from scipy.special import fdtri

        return self.n > 3 and self.ratio > fdtri(1, self.n - 3, 1.0 - LEVEL)


def power_law(u: np.ndarray, y: np.ndarray) -> tuple[float, float, float]:
    """Fit y = a + p u by least squares: (a, p, sum of squares)."""
    du = u - u.mean()
    p = float(du @ y / (du @ du))
    r = y - y.mean() - p * du
    return float(y.mean() - p * u.mean()), p, float(r @ r)


def fit_plateau(h: np.ndarray, err: np.ndarray) -> PlateauFit:
    """Fit log(C + M h^p) to log err by least squares, with C >= 0.

    h, err (n,): both > 0. A grid of (p, C / M), refined by Gauss-Newton.
    """
    ref = float(np.exp(np.log(h).mean()))
    u = np.log(h / ref)
    y = np.log(err)
    a, p0, rss0 = power_law(u, y)
    best = (rss0, p0, -np.inf, a)
    p = np.geomspace(0.1, 12.0, 30)[:, None, None]
    v = np.linspace(-10.0, 10.0, 41)[None, :, None] + 0.5 * p * (
        u.min() + u.max()
    )  # v = log(C / M)
    resid = y - np.logaddexp(v, p * u)
    rss = resid.var(axis=-1) * len(u)
    # every local minimum of the grid could hold the best fit; the three lowest are enough in all
    # trials
    for k in np.argsort(rss, axis=None)[:3]:
        i, j = np.unravel_index(k, rss.shape)
        found = _refine(u, y, float(p[i, 0, 0]), float(v[i, j, 0]))
        if found[0] < best[0]:
            best = found
    rss1, q, w, b = best
    M = np.exp(b) / ref**q
    return PlateauFit(
        float(np.exp(b + w)) if np.isfinite(w) else 0.0, float(M), q, rss1, rss0, len(u)
    )


def _refine(u, y, p, v):
    """Minimise over (p, v) by Levenberg-Marquardt for y = b + log(e^v + e^(p u)), b eliminated.

    Returns (rss, p, v, b).
    """

    def value(p: float, v: float) -> tuple[float, np.ndarray, float, np.ndarray]:
        z = np.logaddexp(v, p * u)
        b = float((y - z).sum() / len(y))  # of few values, numpy's mean takes three times as long
        r = y - z - b
        return float(r @ r), r, b, z

    rss, r, b, z = value(p, v)
    damp = 1e-3
    for _ in range(40):
        w = np.exp(v - z)
        J = np.stack([(1.0 - w) * u, w], 1)
        J -= J.mean(0)
        A = J.T @ J
        g = J.T @ r
        A[0, 0] += damp * A[0, 0] + 1e-300
        A[1, 1] += damp * A[1, 1] + 1e-300
        det = A[0, 0] * A[1, 1] - A[0, 1] ** 2
        if not det > 0.0:
            break
        dp = (A[1, 1] * g[0] - A[0, 1] * g[1]) / det
        dv = (A[0, 0] * g[1] - A[0, 1] * g[0]) / det
        q = min(max(p + dp, 1e-3), 20.0)
        s = min(max(v + dv, v - 5.0), v + 5.0)
        trial = value(q, s)
        if trial[0] < rss:
            gain = rss - trial[0]
            p = q
            v = s
            damp = damp / 5
            rss, r, b, z = trial
            if gain <= 1e-10 * rss:
                break
        else:
            damp *= 5
            if damp > 1e8:
                break
    return rss, p, v, b


def persists(h: np.ndarray, err: np.ndarray, full: PlateauFit) -> bool:
    """Does the plateau of the errors err (k,) at the steps h (k,) survive a smallest step four
    times finer?

    The fit without the finest two octaves must foresee the level: a convex but converging error (h
    + 100 h^3) shows a C that falls with the smallest step, like the error itself. And at the fine
    end (one and a half octaves: with C = 4 M h^p there the local slope is a fifth to two fifths of
    p) the error must fall less than half as fast as M h^p.
    """
    from scipy.special import fdtri

    # a high order levels off sooner: the same share of h^p
    end = max(h.min() * END ** (1.0 / max(full.p, 1.0)), np.sort(h)[min(3, len(h) - 1)])
    coarse = h >= FINER * h.min() * (1 - 1e-9)
    fine = h <= end * (1 + 1e-9)
    if coarse.sum() < 5 or fine.sum() < 3:
        return False
    before = fit_plateau(h[coarse], err[coarse])
    slope = power_law(np.log(h[fine]), np.log(err[fine]))[1]
    if _rises(h, err):  # rounding or divergence, no level
        return False
    off = np.log(err[coarse]) - np.log(full.C + full.M * h[coarse] ** full.p)
    free = max(before.n - 3, 1)
    foreseen = (
        full.C > 0.5 * before.C
        or (off @ off - before.rss) / 3 < fdtri(3, free, 0.95) * before.rss / free
    )
    return foreseen and slope < 0.5 * full.p


def claimed(h: np.ndarray, err: np.ndarray) -> PlateauFit | None:
    """Find the plateau that the errors err (k,) at the steps h (k,) show; None without one.

    Significant against a power law; persistent; no worse (within one s^2) than a power law with a
    head, which bends the same way but at the coarse end; and not significantly worse than a very
    slow convergence, such as that of 1 / log h.
    """
    from scipy.special import fdtri

    level = fit_plateau(h, err)
    if not (level.C > 0.0 and level.significant and persists(h, err, level)):
        return None
    u = np.log(h)
    y = np.log(err)
    free = level.n - 3
    if level.rss - convergent(u, y, SLOWEST) > level.rss / free:
        return None
    creeping = convergent(u, y, CREEPING)
    return level if (level.rss - creeping) / (creeping / free) < fdtri(1, free, 0.95) else None


def _rises(h: np.ndarray, err: np.ndarray) -> bool:
    """Do the finest errors lie above the smallest by more than noise?

    By medians of three; noise from second differences.
    """
    y = np.log(err[np.argsort(h)])
    middle = np.median(np.lib.stride_tricks.sliding_window_view(y, 3), axis=1)
    noise = float(np.std(np.diff(y, 2))) / np.sqrt(6.0)
    return bool(middle[0] - middle.min() > max(RISEN, 4.0 * noise))


def cannot_exclude(h: np.ndarray, err: np.ndarray, head: bool = True) -> bool:
    """Does M (C h_min^p + h^p), with or without a head, fit as well as the power law? h, err (k,).

    The power law has its head, or none (head=False). As well: for C of LARGE to 4 LARGE not worse
    at 5 % (F); for a quarter or half of LARGE, which takes more points to exclude, better.
    """
    from scipy.special import fdtri

    u = np.log(h / h.min())
    y = np.log(err)
    n = len(h)
    if n < 6:
        return True
    rss = power_law(u, y)[2]
    free = n - 2
    shapes = (y,)
    if head:
        headed = fit_corrected(u, y)
        rss = headed.rss
        free = headed.freedom / headed.inflation
        shapes = (y, y - headed.head)
    least = [min(_with_level(u, z, LARGE * k) for z in shapes) for k in (0.25, 0.5, 1.0, 2.0, 4.0)]
    noise = max(rss / free, (8 * np.finfo(float).eps) ** 2)
    return (min(least[2:]) - rss) / noise < fdtri(1, free, 0.95) or min(least) <= rss


def _with_level(u, y, times) -> float:
    """Return the least sum of squares of y - log M - log(times + e^(p u)) over M and p >= 0."""
    best = np.inf
    for p in (0.5, 2.0):
        for _ in range(30):
            z = np.logaddexp(np.log(times), p * u)
            r = y - z
            r -= r.sum() / len(r)
            best = min(best, float(r @ r))
            J = u * np.exp(p * u - z)
            J -= J.sum() / len(J)
            step = min(max(float(J @ r) / max(float(J @ J), 1e-300), -0.5), 0.5)
            p = min(max(p + step, 0.0), 20.0)
            if abs(step) < 1e-6:
                break
    return best
