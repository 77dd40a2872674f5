"""Proven bounds of the sweep constants of one packing, whatever the order and the gaps.

A sweep obeys c_k (g_k + q_k + c_k) = 0, q_k = sum_{l before k} a_kl c_l. Multiply by w_k^2, with
w_l = exp(-mu dist(l, k0)) for the contact k0 in question; d = W c, D_kl = dist(k) - dist(l):

    d . M d <= w . d,     2 M_kk = 2,    2 M_kl = a_kl exp(|D_kl|)   if a_kl < 0,
                                         2 M_kl = a_kl exp(-|D_kl|)  if a_kl > 0   (exponents x mu)

for any order, because d >= 0 and the two orders of a pair give a_kl exp(+-mu D_kl). Where M is
positive definite this is an ellipsoid, on which v'_k0 <= sum_l (a^-_{k0 l} / w_l) d_l = beta . d is
at most [beta . M^-1 w + sqrt(beta . M^-1 beta  w . M^-1 w)] / 2. The bound of C is the largest of
these over k0, each at its best mu.

For sums the difference of two sweeps, d = W (c - c~), has both signs, and with weights that grow
away from the one gap that differs,

    d . ((A + I) - R) d / 2 <= d_j |dg_j|,    R_kl = |a_kl| (exp(mu |D_kl|) - 1),

so |d| <= 2 / (1 - rho) with rho >= |R|, and |v'|_1 <= sum_l kappa_l |c_l - c~_l|, kappa the column
sums of a^-. The gaps are violated one after the other, and the parts are added up.

All numbers are computed in double precision, without directed rounding.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

GOLDEN = (np.sqrt(5.0) - 1.0) / 2.0
SEARCH_STEPS = 18  # of the golden section: mu to 2e-4 of its interval
MAX_MU = 2.0  # a decay by e^-2 per contact is more than any packing has
# where the golden section starts looking
GRID = np.array([0.05, 0.1, 0.2, 0.4, 0.7, 1.0, 1.5, MAX_MU])
POWER_STEPS = 12  # for the norm of a non-negative matrix; any number gives an upper bound


def bound_violation(gram: np.ndarray, distance: np.ndarray, contacts: list[int]) -> float:
    """Return a proven bound of C: the largest violation left from gaps g >= -1, in any order.

    distance (m, m): in the dual graph. contacts: one of each kind up to symmetry, or all.
    """
    return max(_minimise(lambda mu, k=k: _bound_at(gram, distance[k], k, mu)) for k in contacts)


def bound_sum(gram: np.ndarray, distance: np.ndarray, contacts: list[int]) -> float:
    """Return a proven bound of C': the sum of violations left over the sum before, in any order."""
    return max(_minimise(lambda mu, k=k: _sum_bound_at(gram, distance[k], mu)) for k in contacts)


def bound_corrections(gram: np.ndarray, distance: np.ndarray) -> np.ndarray:
    """Return proven upper bounds (m,) of the corrections c_k from gaps g >= -1, in any order."""
    unit = np.eye(len(gram))
    bounds = [
        _minimise(lambda mu, k=k: _ellipsoid_bound(gram, distance[k], unit[k], mu))
        for k in range(len(gram))
    ]
    return np.array(bounds)


def _bound_at(gram, distance, k, mu):
    """Bound of v'_k with the decay mu; inf where M is not positive definite."""
    return _ellipsoid_bound(gram, distance, np.maximum(-gram[k], 0.0), mu)


def _ellipsoid_bound(gram, distance, load, mu):
    """Bound of sum_l load_l c_l, load (m,) >= 0; inf where M is not positive definite."""
    near = np.isfinite(distance)
    a = gram[np.ix_(near, near)]
    d = distance[near]
    exponent = mu * np.abs(d[:, None] - d)
    doubled = a * np.exp(np.where(a < 0.0, exponent, -exponent))
    np.fill_diagonal(doubled, 2.0)
    w = np.exp(-mu * d)
    beta = load[near] / w
    try:
        factor = cho_factor(doubled / 2.0)
    except LinAlgError:
        return np.inf
    at_w = cho_solve(factor, w)
    at_beta = cho_solve(factor, beta)
    # a nearly singular factor: the bound would be large, and its rounding larger
    if not (w @ at_w > 0.0 and beta @ at_beta >= 0.0):
        return np.inf
    return float(beta @ at_w + np.sqrt((beta @ at_beta) * (w @ at_w))) / 2.0


def _sum_bound_at(gram, distance, mu):
    """Bound of |v'|_1 for one violated gap; inf where rho >= 1."""
    near = np.isfinite(distance)
    a = gram[np.ix_(near, near)]
    d = distance[near]
    off = np.abs(a) - np.diag(np.abs(np.diag(a)))
    rho = norm_bound(off * np.expm1(mu * np.abs(d[:, None] - d)))
    if rho >= 1.0:
        return np.inf
    kappa = np.maximum(-a, 0.0).sum(axis=0)
    return float(np.linalg.norm(kappa * np.exp(-mu * d)) * 2.0 / (1.0 - rho))


def bound_equal_discs() -> float:
    """Return a proven bound of C for every packing of equal discs in the plane, of any number.

    C <= 2 e^mu sqrt(3/4) S^(1/2) / (1 - 3 (e^mu - 1)),  S = sum_l exp(-2 mu dist(l, k)): a disc has
    at most six contacts 60 degrees apart, so that the rows of |A| - I sum to at most 3 and the
    squares of the rows of a^- to at most 3/4; contacts at a distance of at most d lie on discs
    inside a circle of radius 2 d + 2, at most (2 d + 2)^2 discs with three contacts each.
    """

    def at(mu: float) -> float:
        room = 1.0 - 3.0 * np.expm1(mu)
        if mu == 0.0 or room <= 0.0:
            return np.inf
        q = np.exp(-2.0 * mu)
        # sum over d >= 1 of 12 (d + 1)^2 q^d, by parts
        shells = (1.0 - q) * (1.0 + 12.0 * ((1.0 + q) / (1.0 - q) ** 3 - 1.0))
        return float(2.0 * np.exp(mu) * np.sqrt(0.75 * shells) / room)

    return _minimise(at)


def norm_bound(matrix: np.ndarray) -> float:
    """Return an upper bound of the norm of a symmetric non-negative matrix (Collatz & Wielandt).

    For any x > 0 the norm is at most max_k (R x)_k / x_k; x comes from a power iteration.
    """
    x = np.ones(len(matrix))
    for _ in range(POWER_STEPS):
        # R + I has the same eigenvectors and keeps x positive
        x = x + matrix @ x
        x /= x.max()
    return float(((matrix @ x) / x).max())


def _minimise(bound) -> float:
    """Minimise a bound over mu: it is valid at every mu, so the smallest value found is one too."""
    values = [bound(0.0), *(bound(mu) for mu in GRID)]
    best = int(np.argmin(values))
    grid = [0.0, *GRID]
    low = grid[max(best - 1, 0)]
    high = grid[min(best + 1, len(grid) - 1)]
    smallest = values[best]
    for _ in range(SEARCH_STEPS):
        left = high - GOLDEN * (high - low)
        right = low + GOLDEN * (high - low)
        at_left = bound(left)
        at_right = bound(right)
        smallest = min(smallest, at_left, at_right)
        if at_left <= at_right:
            high = right
        else:
            low = left
    return smallest
