"""Enclosures of everything on a tape over a piece of time, with derivatives: the arithmetic of
nsbench.solvers.event_driven.interval_taylor, for tapes.

The path is a polynomial in s, |s| <= 1, over the piece. Row by row, M +- R encloses the
coefficients q^(j)(s) / j! (time in units of the piece's radius) of every operation, j = 0 .. ORDER,
for all s of the piece. What may be undefined somewhere on the piece has infinite radii. Source:
Moore 1966, chapter 11.
"""

from math import atan, cosh, exp, log, sinh, tanh

import numpy as np

from nsbench.compilation.decorators import njit
from nsbench.solvers.event_driven.filippov.kernels.opcodes import (
    ADD,
    AFFINE,
    ATAN,
    CONST,
    COS,
    COSH,
    DIV,
    EXP,
    LOG,
    MUL,
    POW,
    RDIV,
    SECH2,
    SIN,
    SINH,
    SQR,
    SUB,
)
from nsbench.solvers.event_driven.filippov.kernels.polynomial_root import CHOOSE
from nsbench.solvers.event_driven.filippov.kernels.taylor_series import inner
from nsbench.solvers.event_driven.interval_taylor.kernels import TINY, UNIT

# of derivatives: with 9 the cases of tests/studies/speed/filippov.py took 17 to 37 % longer; with
# 15 some more, some less
ORDER = 12
# rounding of the coefficients of a path, relative: a shift of a polynomial adds up its terms
PATH = 4e-14


@inner
def _range(M, R, y, u, v):
    """First entry of row y: the range [u, v], values of a library function."""
    M[y, 0], R[y, 0] = 0.5 * (u + v), 0.5 * (v - u) + 4.0 * UNIT * max(abs(u), abs(v)) + TINY


@inner
def _multiply(M, R, a, b, y):
    """Row y = row a times row b."""
    for k in range(ORDER + 1):
        s = 0.0
        r = TINY
        for i in range(k + 1):
            u = M[a, i]
            v = M[b, k - i]
            dv = R[b, k - i]
            s += u * v
            r += abs(u) * (dv + UNIT * abs(v)) + R[a, i] * (abs(v) + dv)
        M[y, k] = s
        R[y, k] = r


@inner
def _divide(M, R, a, c, b, y):
    """Row y = row a, or the constant c if a < 0, over row b."""
    low = abs(M[b, 0]) - R[b, 0]
    for k in range(ORDER + 1):
        s = c if k == 0 else 0.0
        r = TINY
        if a >= 0:
            s = M[a, k]
            r = R[a, k]
        r += UNIT * abs(s)
        for i in range(1, k + 1):
            u = M[b, i]
            v = M[y, k - i]
            dv = R[y, k - i]
            s -= u * v
            r += abs(u) * (dv + UNIT * abs(v)) + R[b, i] * (abs(v) + dv)
        _over(M, R, y, k, s, r, b, low)


@inner
def _weighted(M, R, a, b, k, flat, slope):
    """Sum over i = 1 .. k of (flat + slope i) a_i b_(k-i), for rows a, b, and its radius."""
    s = 0.0
    r = TINY
    for i in range(1, k + 1):
        w = flat + slope * i
        u = M[a, i]
        du = R[a, i]
        v = M[b, k - i]
        dv = R[b, k - i]
        s += w * u * v
        r += abs(w) * (abs(u) * dv + du * (abs(v) + dv))
        r += (
            UNIT * (abs(flat) + abs(slope) * i) * (abs(u) + du) * (abs(v) + dv)
        )  # w is rounded too, and may cancel
    return s, r


@inner
def _over(M, R, y, k, s, r, w, low):
    """Coefficient k of row y: s +- r over the first entry of row w, which is at least low; nothing
    is known if it may vanish."""
    if low > 0.0:
        M[y, k] = s / M[w, 0]
        R[y, k] = (r + abs(M[y, k]) * R[w, 0]) / low + UNIT * abs(M[y, k]) + TINY
    else:
        M[y, k], R[y, k] = 0.0, np.inf


@inner
def _first(o, c, M, R, a, y):
    """First entries of row y = o(a), a function, and of its partner's, the next row; NaN where it
    may be undefined."""
    m = M[a, 0]
    r = R[a, 0]
    lo = m - r
    hi = m + r
    if o == SIN:
        # ease: of the reduced argument
        s = np.sin(m)
        c = np.cos(m)
        ease = UNIT * (1.0 + 0.1 * abs(m))
        M[y, 0], R[y, 0] = s, min(abs(c) * r + r * r / 2, 2.0) + ease + 4.0 * UNIT
        M[y + 1, 0], R[y + 1, 0] = c, min(abs(s) * r + r * r / 2, 2.0) + ease + 4.0 * UNIT
        return
    below = above = 1.0
    if o == EXP:
        u = exp(lo)
        v = exp(hi)
    elif o == POW:
        u, v = (lo**c, hi**c) if lo > 0.0 else (-np.inf, np.inf)
        u, v = min(u, v), max(u, v)
    elif o == LOG:
        u, v = (log(lo), log(hi)) if lo > 0.0 else (-np.inf, np.inf)
    elif o == ATAN:
        u = atan(lo)
        v = atan(hi)
    elif o == SINH:
        u = sinh(lo)
        v = sinh(hi)
        below = cosh(lo)
        above = cosh(hi)
        below, above = (1.0 if lo < 0.0 < hi else min(below, above)), max(below, above)
    else:  # TANH
        u = tanh(lo)
        v = tanh(hi)
        below = 1.0 - max(u * u, v * v)
        above = 1.0 if lo < 0.0 < hi else 1.0 - min(u * u, v * v)
    _range(M, R, y, u, v)
    if o >= SINH:
        _range(M, R, y + 1, below, above)


@inner
def _further(o, c, M, R, a, b, y, k):
    """Coefficient k >= 1 of row y = o(a, b), and of its partner's; the recurrences of
    kernels.taylor."""
    if o == POW:
        s, r = _weighted(M, R, a, y, k, -1.0, (c + 1.0) / k)
        _over(M, R, y, k, s, r, a, M[a, 0] - R[a, 0])
    elif o == LOG or o == ATAN:
        s, r = _weighted(M, R, b, y, k, -1.0, 1.0 / k)  # nothing of y_0
        _over(M, R, y, k, s + M[a, k], r + R[a, k] + UNIT * abs(M[a, k]), b, abs(M[b, 0]) - R[b, 0])
    else:
        pair = o != EXP
        M[y, k], R[y, k] = _weighted(M, R, a, y + pair, k, 0.0, 1.0 / k)
        if o == SIN or o == SINH:
            M[y + 1, k], R[y + 1, k] = _weighted(
                M, R, a, y, k, 0.0, (-1.0 if o == SIN else 1.0) / k
            )
        elif pair:  # TANH
            s, r = _weighted(M, R, y, y, k, -1.0, 0.0)
            M[y + 1, k], R[y + 1, k] = (
                s - M[y, 0] * M[y, k],
                r + abs(M[y, 0]) * R[y, k] + R[y, 0] * (abs(M[y, k]) + R[y, k]),
            )


@njit(cache=True, error_model="numpy")
def enclose(ops, nums, lo, hi, n, M, R):
    """Rows n + 1 .. of M, R (rows, ORDER + 1), from those of the state and the time."""
    for e in range(lo, hi):
        o = ops[e, 0]
        row = n + 1 + e - lo
        i = ops[e, 1]
        j = ops[e, 2]
        c = nums[e, 0]
        if o == COS or o == COSH or o == SECH2:
            continue
        if o == ADD or o == SUB or o == AFFINE:
            u, v = (c, 0.0) if o == AFFINE else (1.0, 1.0 if o == ADD else -1.0)
            for k in range(ORDER + 1):
                M[row, k] = u * M[i, k] + v * M[j, k]
                R[row, k] = abs(u) * R[i, k] + abs(v) * R[j, k] + UNIT * abs(M[row, k])
            if o == AFFINE:
                M[row, 0] += nums[e, 1]
                R[row, 0] += UNIT * abs(M[row, 0])
            continue
        if o == CONST:
            for k in range(ORDER + 1):
                M[row, k] = 0.0
                R[row, k] = 0.0
            M[row, 0] = c
            continue
        if o == MUL:
            _multiply(M, R, i, j, row)
        elif o == SQR:
            _multiply(M, R, i, i, row)
            u = max(abs(M[i, 0]) - R[i, 0], 0.0)
            v = abs(M[i, 0]) + R[i, 0]
            M[row, 0] = 0.5 * (u * u + v * v)  # it is not negative
            R[row, 0] = 0.5 * (v * v - u * u) * (1.0 + UNIT) + UNIT * (u * u + v * v)
        elif o == DIV or o == RDIV:
            _divide(M, R, i if o == DIV else -1, c, j if o == DIV else i, row)
        else:
            _first(o, c, M, R, i, row)
            for k in range(1, ORDER + 1):
                _further(o, c, M, R, i, j, row, k)


@njit(cache=True, error_model="numpy")
def path(Q, n, p, centre, radius, M, R):
    """Rows of n polynomials Q (n, p + 1) in s, and of the time, over the piece centre +- radius.

    The Taylor coefficient j at s is  sum_k binomial(k, j) q_k s^(k - j).
    """
    for i in range(n):
        for j in range(ORDER + 1):
            M[i, j] = Q[i, j] if j <= p else 0.0
            R[i, j] = PATH * abs(M[i, j])
        for k in range(1, p + 1):
            size = abs(Q[i, k])
            for j in range(min(k, ORDER + 1)):
                R[i, j] += CHOOSE[k, j] * size
    for j in range(ORDER + 1):
        M[n, j] = 0.0
        R[n, j] = 0.0
    M[n, 0] = centre
    M[n, 1] = radius
    R[n, 0] = radius + 1e-15 * (abs(centre) + radius)
    R[n, 1] = 1e-15 * radius
