"""Recurrences for Taylor coefficients with error radii, on arrays (M, ORDER + 1).

Row e holds enclosures  mid[e, j] +- rad[e, j]  of the coefficients  q^(j)(s) / j!  of one function
for all s of a piece. Every product is enclosed exactly as sets of numbers (Moore 1966; Jorba & Zou
2005 for the recurrences); rounding is added as UNIT per term, ten times what one operation loses.
"""

import numpy as np

from nsbench.compilation.decorators import njit

UNIT = 2.5e-15  # ten roundings per term of a sum
TINY = 1e-300  # what underflow may lose


@njit(cache=True, error_model="numpy", inline="always")
def _term(am, ar, bm, br):
    """Return the radius of the product of two enclosures, rounding of its middle included."""
    return abs(am) * br + ar * (abs(bm) + br) + UNIT * abs(am * bm)


@njit(cache=True, error_model="numpy")
def multiply(
    am: np.ndarray, ar: np.ndarray, bm: np.ndarray, br: np.ndarray, cm: np.ndarray, cr: np.ndarray
) -> None:
    """Enclose c = a b by the Cauchy product; all arrays (M, K), K = ORDER + 1."""
    # c_j = sum_i a_i b_(j - i)
    for e in range(am.shape[0]):
        for j in range(am.shape[1]):
            s = 0.0
            r = TINY
            for i in range(j + 1):
                s += am[e, i] * bm[e, j - i]
                r += _term(am[e, i], ar[e, i], bm[e, j - i], br[e, j - i])
            cm[e, j] = s
            cr[e, j] = r


@njit(cache=True, error_model="numpy")
def divide(
    am: np.ndarray, ar: np.ndarray, bm: np.ndarray, br: np.ndarray, cm: np.ndarray, cr: np.ndarray
) -> None:
    """Enclose c = a / b, arrays (M, K), K = ORDER + 1; infinite radii where b may vanish.

    The recurrence of the coefficients follows from c b = a.
    """
    # c_j = (a_j - sum_(i < j) c_i b_(j - i)) / b_0
    for e in range(am.shape[0]):
        low = abs(bm[e, 0]) - br[e, 0]
        for j in range(am.shape[1]):
            if not low > 0.0:
                cm[e, j], cr[e, j] = 0.0, np.inf
                continue
            s = am[e, j]
            r = ar[e, j] + UNIT * abs(am[e, j])
            for i in range(j):
                s -= cm[e, i] * bm[e, j - i]
                r += _term(cm[e, i], cr[e, i], bm[e, j - i], br[e, j - i])
            cm[e, j] = s / bm[e, 0]
            cr[e, j] = (r + abs(cm[e, j]) * br[e, 0]) / low + UNIT * abs(cm[e, j]) + TINY


@njit(cache=True, error_model="numpy")
def power(
    am: np.ndarray,
    ar: np.ndarray,
    m0: np.ndarray,
    r0: np.ndarray,
    alpha: float,
    cm: np.ndarray,
    cr: np.ndarray,
) -> None:
    """Enclose c = a^alpha for a > 0 by the recurrence a c' = alpha a' c.

    a, c (M, K), K = ORDER + 1; m0, r0 (M,): an enclosure m0 +- r0 of a_0^alpha. Infinite radii
    where a may vanish.
    """
    # j a_0 c_j = sum_(i < j) (alpha (j - i) - i) a_(j - i) c_i
    for e in range(am.shape[0]):
        low = am[e, 0] - ar[e, 0]
        cm[e, 0] = m0[e]
        cr[e, 0] = r0[e]
        for j in range(1, am.shape[1]):
            if not low > 0.0:
                cm[e, j], cr[e, j] = 0.0, np.inf
                continue
            s = 0.0
            r = TINY
            for i in range(j):
                w = (alpha * (j - i) - i) / j
                s += w * am[e, j - i] * cm[e, i]
                r += abs(w) * _term(am[e, j - i], ar[e, j - i], cm[e, i], cr[e, i])
            cm[e, j] = s / am[e, 0]
            cr[e, j] = (r + abs(cm[e, j]) * ar[e, 0]) / low + UNIT * abs(cm[e, j])


@njit(cache=True, error_model="numpy")
def exponential(
    am: np.ndarray, ar: np.ndarray, m0: np.ndarray, r0: np.ndarray, cm: np.ndarray, cr: np.ndarray
) -> None:
    """Enclose c = exp a by the recurrence c' = a' c.

    a, c (M, K), K = ORDER + 1; m0, r0 (M,): an enclosure m0 +- r0 of exp a_0.
    """
    integrate(cm, cr, am, ar, m0, r0, cm, cr)  # d = c: coefficient j needs those below j alone


@njit(cache=True, error_model="numpy")
def integrate(
    dm: np.ndarray,
    dr: np.ndarray,
    am: np.ndarray,
    ar: np.ndarray,
    m0: np.ndarray,
    r0: np.ndarray,
    cm: np.ndarray,
    cr: np.ndarray,
) -> None:
    """Enclose c with c' = d a', from an enclosure m0 +- r0 of c_0.

    For log (d = 1/a), arctan (d = 1/(1 + a^2)), tanh and the like. a, c, d (M, K), K = ORDER + 1;
    m0, r0 (M,).
    """
    # j c_j = sum_(i < j) (j - i) a_(j - i) d_i
    for e in range(am.shape[0]):
        cm[e, 0] = m0[e]
        cr[e, 0] = r0[e]
        for j in range(1, am.shape[1]):
            s = 0.0
            r = TINY
            for i in range(j):
                w = (j - i) / j
                s += w * am[e, j - i] * dm[e, i]
                r += w * _term(am[e, j - i], ar[e, j - i], dm[e, i], dr[e, i])
            cm[e, j] = s
            cr[e, j] = r


@njit(cache=True, error_model="numpy")
def circular(
    am: np.ndarray,
    ar: np.ndarray,
    sm: np.ndarray,
    sr: np.ndarray,
    cm: np.ndarray,
    cr: np.ndarray,
    sign: float,
) -> None:
    """Enclose sine s and cosine c (sign = -1) or sinh and cosh (sign = +1) of a.

        s' = a' c,   c' = sign a' s

    The coefficients 0 of s and c are given. a, s, c (M, K), K = ORDER + 1.
    """
    # both recurrences at once: each needs the lower coefficients of the other
    for e in range(am.shape[0]):
        for j in range(1, am.shape[1]):
            s = 0.0
            r = TINY
            u = 0.0
            q = TINY
            for i in range(j):
                w = (j - i) / j
                m = am[e, j - i]
                d = ar[e, j - i]
                s += w * m * cm[e, i]
                r += w * _term(m, d, cm[e, i], cr[e, i])
                u += w * m * sm[e, i]
                q += w * _term(m, d, sm[e, i], sr[e, i])
            sm[e, j] = s
            sr[e, j] = r
            cm[e, j] = sign * u
            cr[e, j] = q
