"""Interval Taylor enclosure of a traced program over a piece of time, derivatives included.

The arithmetic is that of nsbench.dynamics.interval_taylor, for programs.

The path is a polynomial in s, |s| <= 1, over the piece. Row by row, M +- R encloses the
coefficients q^(j)(s) / j! (time in units of the piece's radius) of every operation, j = 0 .. ORDER,
for all s of the piece. What may be undefined somewhere on the piece has infinite radii.
Source: Moore, Interval Analysis, 1966, chapter 11.
"""

from math import atan, cosh, exp, log, sinh, tanh

import numpy as np

from nsbench.compilation.decorators import inner_kernel, njit
from nsbench.solvers.event_driven.filippov.kernels import opcodes as op
from nsbench.solvers.event_driven.filippov.kernels.loop_state import ALL_END, BEGIN
from nsbench.solvers.event_driven.filippov.kernels.polynomial_root import CHOOSE
from nsbench.dynamics.interval_taylor.kernels.coefficient_recurrences import TINY, UNIT

# of derivatives: with 9 the cases of tests/studies/speed/filippov.py took 17 to 37 % longer; with
# 15 some more, some less
ORDER = 12
# rounding of the coefficients of a path, relative: a shift of a polynomial adds up its terms
PATH_ROUNDING = 4e-14


@inner_kernel
def _range(M, R, y, u, v):
    """Set the first entry of row y to the range [u, v] of a library function."""
    M[y, 0] = 0.5 * (u + v)
    R[y, 0] = 0.5 * (v - u) + 4.0 * UNIT * max(abs(u), abs(v)) + TINY


@inner_kernel
def _multiply(M, R, a, b, y):
    """Fill row y with row a times row b."""
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


@inner_kernel
def _divide(M, R, a, c, b, y):
    """Fill row y with row a, or the constant c if a < 0, over row b."""
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


@inner_kernel
def _weighted(M, R, a, b, k, flat, slope):
    """Return the sum over i = 1 .. k of (flat + slope i) a_i b_(k-i), for rows a, b, and its
    radius."""
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


@inner_kernel
def _over(M, R, y, k, s, r, w, low):
    """Set coefficient k of row y to s +- r over the first entry of row w, which is at least low in
    size; nothing is known if that may vanish."""
    if low > 0.0:
        M[y, k] = s / M[w, 0]
        R[y, k] = (r + abs(M[y, k]) * R[w, 0]) / low + UNIT * abs(M[y, k]) + TINY
    else:
        M[y, k] = 0.0
        R[y, k] = np.inf


@inner_kernel
def _first_coefficient(code, c, M, R, a, y):
    """Set the first entries of row y = f(a), f the function `code`, and of its partner's, the next
    row; NaN where it may be undefined."""
    m = M[a, 0]
    r = R[a, 0]
    lo = m - r
    hi = m + r
    if code == op.SIN:
        # ease: of the reduced argument
        s = np.sin(m)
        c = np.cos(m)
        ease = UNIT * (1.0 + 0.1 * abs(m))
        M[y, 0], R[y, 0] = s, min(abs(c) * r + r * r / 2, 2.0) + ease + 4.0 * UNIT
        M[y + 1, 0], R[y + 1, 0] = c, min(abs(s) * r + r * r / 2, 2.0) + ease + 4.0 * UNIT
        return
    below = above = 1.0
    if code == op.EXP:
        u = exp(lo)
        v = exp(hi)
    elif code == op.POW:
        u, v = (lo**c, hi**c) if lo > 0.0 else (-np.inf, np.inf)
        u, v = min(u, v), max(u, v)
    elif code == op.LOG:
        u, v = (log(lo), log(hi)) if lo > 0.0 else (-np.inf, np.inf)
    elif code == op.ATAN:
        u = atan(lo)
        v = atan(hi)
    elif code == op.SINH:
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
    if code >= op.SINH:
        _range(M, R, y + 1, below, above)


@inner_kernel
def _higher_coefficient(code, c, M, R, a, b, y, k):
    """Set coefficient k >= 1 of row y = f(a, b), f the function `code`, and of its partner's, by
    the recurrences of kernels.taylor_series."""
    if code == op.POW:
        s, r = _weighted(M, R, a, y, k, -1.0, (c + 1.0) / k)
        _over(M, R, y, k, s, r, a, M[a, 0] - R[a, 0])
    elif code == op.LOG or code == op.ATAN:
        s, r = _weighted(M, R, b, y, k, -1.0, 1.0 / k)  # nothing of y_0
        _over(M, R, y, k, s + M[a, k], r + R[a, k] + UNIT * abs(M[a, k]), b, abs(M[b, 0]) - R[b, 0])
    else:
        pair = code != op.EXP
        M[y, k], R[y, k] = _weighted(M, R, a, y + pair, k, 0.0, 1.0 / k)
        if code == op.SIN or code == op.SINH:
            M[y + 1, k], R[y + 1, k] = _weighted(
                M, R, a, y, k, 0.0, (-1.0 if code == op.SIN else 1.0) / k
            )
        elif pair:  # TANH
            s, r = _weighted(M, R, y, y, k, -1.0, 0.0)
            M[y + 1, k], R[y + 1, k] = (
                s - M[y, 0] * M[y, k],
                r + abs(M[y, 0]) * R[y, k] + R[y, 0] * (abs(M[y, k]) + R[y, k]),
            )


@inner_kernel
def _enclose_operation(code, i, j, c, d, M, R, row):
    """Fill row `row`, and of a pair the next one, with the operation `code` of rows i and j and of
    constants c and d."""
    if code == op.ADD or code == op.SUB or code == op.AFFINE:
        u, v = (c, 0.0) if code == op.AFFINE else (1.0, 1.0 if code == op.ADD else -1.0)
        for k in range(ORDER + 1):
            M[row, k] = u * M[i, k] + v * M[j, k]
            R[row, k] = abs(u) * R[i, k] + abs(v) * R[j, k] + UNIT * abs(M[row, k])
        if code == op.AFFINE:
            M[row, 0] += d
            R[row, 0] += UNIT * abs(M[row, 0])
    elif code == op.CONST:
        for k in range(ORDER + 1):
            M[row, k] = 0.0
            R[row, k] = 0.0
        M[row, 0] = c
    elif code == op.MUL:
        _multiply(M, R, i, j, row)
    elif code == op.SQR:
        _multiply(M, R, i, i, row)
        u = max(abs(M[i, 0]) - R[i, 0], 0.0)
        v = abs(M[i, 0]) + R[i, 0]
        M[row, 0] = 0.5 * (u * u + v * v)  # it is not negative
        R[row, 0] = 0.5 * (v * v - u * u) * (1.0 + UNIT) + UNIT * (u * u + v * v)
    elif code == op.DIV or code == op.RDIV:
        _divide(M, R, i if code == op.DIV else -1, c, j if code == op.DIV else i, row)
    else:
        _first_coefficient(code, c, M, R, i, row)
        for k in range(1, ORDER + 1):
            _higher_coefficient(code, c, M, R, i, j, row, k)


@inner_kernel
def _bound_unknown(M, R, row):
    """Give the coefficients of a row that overflow, or are 0 times infinity, infinite radii."""
    for k in range(ORDER + 1):
        if not (abs(M[row, k]) < np.inf and R[row, k] < np.inf):
            M[row, k] = 0.0
            R[row, k] = np.inf


@njit(cache=True, error_model="numpy")
def enclose(ops, nums, first, n, M, R):
    """Fill rows n + 1 .. of M, R (rows, ORDER + 1), from those of the state and the time. first
    (3,): where the operations of the program lie, as a row of Programs.first."""
    lo = first[BEGIN]
    for e in range(lo, first[ALL_END]):
        code = ops[e, 0]
        row = n + 1 + e - lo
        if code == op.COS or code == op.COSH or code == op.SECH2:
            continue
        _enclose_operation(code, ops[e, 1], ops[e, 2], nums[e, 0], nums[e, 1], M, R, row)
        _bound_unknown(M, R, row)
        if code == op.SIN or code == op.SINH or code == op.TANH:
            _bound_unknown(M, R, row + 1)


@inner_kernel
def path(Q, n, p, centre, radius, M, R):
    """Fill rows 0 .. n of M, R with n polynomials Q (n, p + 1) in s and with the time, over the
    piece centre +- radius.

    The Taylor coefficient j at s is  sum_k binomial(k, j) q_k s^(k - j).
    """
    for i in range(n):
        for j in range(ORDER + 1):
            M[i, j] = Q[i, j] if j <= p else 0.0
            R[i, j] = PATH_ROUNDING * abs(M[i, j])
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
