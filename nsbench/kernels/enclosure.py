"""Enclosures of everything on a tape over a piece of time, with derivatives: the interpreter of nsbench.jets' arithmetic.

The path is a polynomial in s, |s| <= 1, over the piece. Row by row, M +- R encloses the coefficients q^(j)(s) / j! (time in
units of the piece's radius) of every operation, j = 0 .. ORDER, for all s of the piece. What may be undefined somewhere on
the piece has infinite radii. Source: Moore 1966, chapter 11; the rows are those of kernels.jets.
"""
from math import atan, comb, cosh, exp, log, sinh, tanh

import numpy as np
from numba import njit

from nsbench.kernels.jets import TINY, UNIT, circular, divide, exponential, multiply
from nsbench.kernels.jets import power as root
from nsbench.kernels.tapecodes import (
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

ORDER = 9               # as in nsbench.jets
DEGREE = 40             # largest degree of a path
BINOMIAL = np.array([[float(comb(k, j)) for k in range(DEGREE + 1)] for j in range(ORDER + 1)])
PATH = 4e-14            # rounding of the coefficients of a path, relative: a shift of a polynomial adds up DEGREE terms


@njit(cache=True, error_model="numpy")
def _between(u, v, M, R):
    """First entry of a row: the range [u, v], values of a library function."""
    M[0, 0], R[0, 0] = 0.5 * (u + v), 0.5 * (v - u) + 4.0 * UNIT * max(abs(u), abs(v)) + TINY


@njit(cache=True, error_model="numpy")
def _square(am, ar, cm, cr):
    """c = a a, knowing that it is not negative."""
    multiply(am, ar, am, ar, cm, cr)
    u, v = abs(am[0, 0]) - ar[0, 0], abs(am[0, 0]) + ar[0, 0]
    u = max(u, 0.0)
    cm[0, 0], cr[0, 0] = 0.5 * (u * u + v * v), 0.5 * (v * v - u * u) * (1.0 + UNIT) + UNIT * (u * u + v * v)


@njit(cache=True, error_model="numpy")
def _primitive(am, ar, wm, wr, cm, cr):
    """c with c' = a' / w, its first entry given: of log and arctan."""
    low = abs(wm[0, 0]) - wr[0, 0]
    for k in range(1, am.shape[1]):
        if not low > 0.0:
            cm[0, k], cr[0, k] = 0.0, np.inf
            continue
        s, r = am[0, k], ar[0, k] + UNIT * abs(am[0, k])
        for i in range(1, k):
            f = i / k
            s -= f * cm[0, i] * wm[0, k - i]
            r += f * (abs(cm[0, i]) * wr[0, k - i] + cr[0, i] * (abs(wm[0, k - i]) + wr[0, k - i])
                      + UNIT * abs(cm[0, i] * wm[0, k - i]))
        cm[0, k] = s / wm[0, 0]
        cr[0, k] = (r + abs(cm[0, k]) * wr[0, 0]) / low + UNIT * abs(cm[0, k]) + TINY


@njit(cache=True, error_model="numpy")
def _tangent(am, ar, cm, cr, dm, dr):
    """c = tanh a and d = 1 - c c, both first entries given:  c' = d a'."""
    for k in range(1, am.shape[1]):
        s, r = 0.0, TINY
        for i in range(1, k + 1):
            f = i / k
            s += f * am[0, i] * dm[0, k - i]
            r += f * (abs(am[0, i]) * dr[0, k - i] + ar[0, i] * (abs(dm[0, k - i]) + dr[0, k - i])
                      + UNIT * abs(am[0, i] * dm[0, k - i]))
        cm[0, k], cr[0, k] = s, r
        s, r = 0.0, TINY
        for i in range(k + 1):
            s -= cm[0, i] * cm[0, k - i]
            r += (abs(cm[0, i]) * cr[0, k - i] + cr[0, i] * (abs(cm[0, k - i]) + cr[0, k - i])
                  + UNIT * abs(cm[0, i] * cm[0, k - i]))
        dm[0, k], dr[0, k] = s, r


@njit(cache=True, error_model="numpy")
def _circle(m, r, sm, sr, cm, cr):
    """First entries of sine and cosine at m +- r."""
    s, c = np.sin(m), np.cos(m)
    ease = UNIT * (1.0 + 0.1 * abs(m))              # of the reduced argument
    sm[0, 0], sr[0, 0] = s, min(abs(c) * r + r * r / 2, 2.0) + ease + 4.0 * UNIT
    cm[0, 0], cr[0, 0] = c, min(abs(s) * r + r * r / 2, 2.0) + ease + 4.0 * UNIT


@njit(cache=True, error_model="numpy")
def _function(o, c, am, ar, wm, wr, ym, yr, zm, zr):
    """Rows of an elementary function and, for pairs, of its partner z."""
    lo, hi = am[0, 0] - ar[0, 0], am[0, 0] + ar[0, 0]
    if o == SIN:
        _circle(am[0, 0], ar[0, 0], ym, yr, zm, zr)
        circular(am, ar, ym, yr, zm, zr, -1.0)
    elif o == EXP:
        _between(exp(lo), exp(hi), ym, yr)
        exponential(am, ar, ym[:, 0].copy(), yr[:, 0].copy(), ym, yr)
    elif o == POW:
        lo, hi = max(lo, 0.0), max(hi, 0.0)
        u, v = lo**c, hi**c
        _between(min(u, v), max(u, v), ym, yr)
        root(am, ar, ym[:, 0].copy(), yr[:, 0].copy(), c, ym, yr)
    elif o == LOG:
        if lo > 0.0:
            _between(log(lo), log(hi), ym, yr)
        else:
            ym[0, 0], yr[0, 0] = 0.0, np.inf
        _primitive(am, ar, wm, wr, ym, yr)
    elif o == ATAN:
        _between(atan(lo), atan(hi), ym, yr)
        _primitive(am, ar, wm, wr, ym, yr)
    elif o == SINH:
        _between(sinh(lo), sinh(hi), ym, yr)
        _between(1.0 if lo < 0.0 < hi else min(cosh(lo), cosh(hi)), max(cosh(lo), cosh(hi)), zm, zr)
        circular(am, ar, ym, yr, zm, zr, 1.0)
    else:                                           # TANH
        u, v = tanh(lo), tanh(hi)
        _between(u, v, ym, yr)
        _between(1.0 - max(u * u, v * v), 1.0 if lo < 0.0 < hi else 1.0 - min(u * u, v * v), zm, zr)
        _tangent(am, ar, ym, yr, zm, zr)


@njit(cache=True, error_model="numpy")
def enclose(ops, nums, lo, hi, n, M, R):
    """Rows n + 1 .. of M, R (rows, ORDER + 1), from those of the state and the time."""
    for e in range(lo, hi):
        o, row, i, j = ops[e, 0], n + 1 + e - lo, ops[e, 1], ops[e, 2]
        if o == COS or o == COSH or o == SECH2:
            continue
        if o == ADD or o == SUB:
            sign = 1.0 if o == ADD else -1.0
            for k in range(ORDER + 1):
                M[row, k] = M[i, k] + sign * M[j, k]
                R[row, k] = R[i, k] + R[j, k] + UNIT * abs(M[row, k])
        elif o == AFFINE:
            for k in range(ORDER + 1):
                M[row, k] = nums[e, 0] * M[i, k]
                R[row, k] = abs(nums[e, 0]) * R[i, k] + UNIT * abs(M[row, k])
            M[row, 0] += nums[e, 1]
            R[row, 0] += UNIT * abs(M[row, 0])
        elif o == CONST or o == RDIV:
            for k in range(ORDER + 1):
                M[row, k], R[row, k] = 0.0, 0.0
            M[row, 0] = nums[e, 0]
            if o == RDIV:
                one, zero = M[row:row + 1].copy(), R[row:row + 1].copy()
                divide(one, zero, M[i:i + 1], R[i:i + 1], M[row:row + 1], R[row:row + 1])
        elif o == MUL:
            multiply(M[i:i + 1], R[i:i + 1], M[j:j + 1], R[j:j + 1], M[row:row + 1], R[row:row + 1])
        elif o == SQR:
            _square(M[i:i + 1], R[i:i + 1], M[row:row + 1], R[row:row + 1])
        elif o == DIV:
            divide(M[i:i + 1], R[i:i + 1], M[j:j + 1], R[j:j + 1], M[row:row + 1], R[row:row + 1])
        else:
            z = min(row + 1, M.shape[0] - 1)
            _function(o, nums[e, 0], M[i:i + 1], R[i:i + 1], M[j:j + 1], R[j:j + 1], M[row:row + 1], R[row:row + 1],
                      M[z:z + 1], R[z:z + 1])


@njit(cache=True, error_model="numpy")
def path(Q, n, p, centre, radius, M, R):
    """Rows of n polynomials Q (n, p + 1) in s, and of the time, over the piece centre +- radius.

    The Taylor coefficient j at s is  sum_k binomial(k, j) q_k s^(k - j).
    """
    for i in range(n):
        for j in range(ORDER + 1):
            M[i, j], R[i, j] = (Q[i, j], PATH * abs(Q[i, j])) if j <= p else (0.0, 0.0)
            for k in range(j + 1, p + 1):
                R[i, j] += BINOMIAL[j, k] * abs(Q[i, k])
    for j in range(ORDER + 1):
        M[n, j], R[n, j] = 0.0, 0.0
    M[n, 0], M[n, 1] = centre, radius
    R[n, 0], R[n, 1] = radius + 1e-15 * (abs(centre) + radius), 1e-15 * radius
