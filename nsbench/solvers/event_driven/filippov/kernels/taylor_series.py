"""Taylor coefficients of everything on a tape: an interpreter, compiled once for all of them.

A tape is a list of operations ops[e] = (op, a, b), nums[e] = (c, d) (see tapecodes); operation e
makes row n + 1 + e - lo of a table whose rows 0 .. n - 1 are the state and whose row n is the time.
`series` fills a table (rows, p + 1) of normalised Taylor coefficients of the solution of x_i' =
(row F[i]); `point` fills one column, the values at one point.
Source of the recurrences: Jorba & Zou, Experimental Mathematics 14 (2005), proposition 2.1.
"""

from math import atan, cos, cosh, exp, log, sin, sinh, tanh

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
    TANH,
)

# only called by kernels: without the wrappers for Python they compile in half the time
inner = njit(cache=True, error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True)


@inner
def power(a, alpha):
    """a ** alpha for a > 0, with the root's own rounding for alpha = 1/2."""
    return np.sqrt(a) if alpha == 0.5 else a**alpha


@inner
def head(op, u, v, c, d):
    """Value of an operation without partner, and of the first of a pair, at the values u, v of its
    rows."""
    if op == ADD:
        return u + v
    if op == SUB:
        return u - v
    if op == MUL:
        return u * v
    if op == AFFINE:
        return c * u + d
    if op == SQR:
        return u * u
    if op == DIV:
        return u / v
    if op == RDIV:
        return c / u
    if op == SIN:
        return sin(u)
    if op == EXP:
        return exp(u)
    if op == POW:
        return power(u, c)
    if op == LOG:
        return log(u) if u > 0.0 else np.nan
    if op == ATAN:
        return atan(u)
    if op == TANH:
        return tanh(u)
    if op == SINH:
        return sinh(u)
    return c  # CONST


@inner
def partner(op, u, y):
    """Value of the second of a pair."""
    if op == SIN:
        return cos(u)
    if op == SINH:
        return cosh(u)
    return 1.0 - y * y


@njit(cache=True, error_model="numpy")
def point(ops, nums, lo, hi, n, V, many):
    """Values V[n + 1 :, :many] at the states V[:n, :many] and the times V[n, :many], for `many`
    points."""
    for e in range(lo, hi):
        o = ops[e, 0]
        u = ops[e, 1]
        v = ops[e, 2]
        row = n + 1 + e - lo
        if o == COS or o == COSH or o == SECH2:
            continue
        for k in range(many):
            V[row, k] = head(o, V[u, k], V[v, k], nums[e, 0], nums[e, 1])
            if o == SIN or o == SINH or o == TANH:
                V[row + 1, k] = partner(o, V[u, k], V[row, k])


# sums of products in any order: so the compiler may add four at a time
summing = njit(
    cache=True,
    error_model="numpy",
    no_cpython_wrapper=True,
    no_cfunc_wrapper=True,
    fastmath={"reassoc", "contract"},
)


@summing
def _product(C, u, v, first, k):
    """Sum over i = first .. k of u_i v_(k-i), for rows u, v."""
    s = 0.0
    for i in range(first, k + 1):
        s += C[u, i] * C[v, k - i]
    return s


@summing
def _weighted(C, u, v, last, k):
    """Sum over i = 1 .. last of i u_i v_(k-i), for rows u, v: of u' v, at last = k coefficient k -
    1."""
    s = 0.0
    for i in range(1, last + 1):
        s += i * C[u, i] * C[v, k - i]
    return s


@inner
def _coefficient(o, C, u, v, y, w, k):
    """Set coefficient k >= 1 of row y = op(u, v) with constant w; of a pair, that of the next row
    too."""
    if o == ADD:
        C[y, k] = C[u, k] + C[v, k]
    elif o == SUB:
        C[y, k] = C[u, k] - C[v, k]
    elif o == AFFINE:
        C[y, k] = w * C[u, k]
    elif o == MUL:
        C[y, k] = _product(C, u, v, 0, k)
    elif o == SQR:
        s = 0.0
        for i in range((k + 1) // 2):
            s += C[u, i] * C[u, k - i]
        C[y, k] = 2.0 * s if k % 2 else 2.0 * s + C[u, k // 2] * C[u, k // 2]
    elif o == DIV:
        C[y, k] = (C[u, k] - _product(C, v, y, 1, k)) / C[v, 0]
    elif o == RDIV:
        C[y, k] = -_product(C, u, y, 1, k) / C[u, 0]
    elif o == EXP:
        C[y, k] = _weighted(C, u, y, k, k) / k
    elif o == POW:
        s = 0.0
        for i in range(k):
            s += (w * (k - i) - i) * C[u, k - i] * C[y, i]
        C[y, k] = s / (k * C[u, 0])
    elif o == LOG or o == ATAN:
        C[y, k] = (C[u, k] - _weighted(C, y, v, k - 1, k) / k) / C[v, 0]
    elif o == SIN:
        C[y + 1, k] = -_weighted(C, u, y, k, k) / k
        C[y, k] = _weighted(C, u, y + 1, k, k) / k
    elif o == SINH:
        C[y + 1, k] = _weighted(C, u, y, k, k) / k
        C[y, k] = _weighted(C, u, y + 1, k, k) / k
    elif o == TANH:
        C[y, k] = _weighted(C, u, y + 1, k, k) / k
        C[y + 1, k] = -_product(C, y, y, 0, k)
    elif o == CONST:
        C[y, k] = 0.0  # a second of a pair is made with the first


@njit(cache=True, error_model="numpy")
def series(ops, nums, lo, mid, hi, F, n, p, C):
    """Table C (rows, >= p + 1): coefficients 0 .. p of state and operations, from C[:n, 0] and the
    time C[n, 0].

    Operations lo .. mid - 1 make the derivatives, order by order; the others follow one by one when
    the state is known.
    """
    for k in range(1, p + 1):
        C[n, k] = 0.0
    C[n, 1] = 1.0
    for e in range(lo, hi):
        o = ops[e, 0]
        row = n + 1 + e - lo
        if o == COS or o == COSH or o == SECH2:
            continue
        C[row, 0] = head(o, C[ops[e, 1], 0], C[ops[e, 2], 0], nums[e, 0], nums[e, 1])
        if o == SIN or o == SINH or o == TANH:
            C[row + 1, 0] = partner(o, C[ops[e, 1], 0], C[row, 0])
    for part in range(p + hi - mid):  # one loop for both, so that the branches below are there once
        begin = lo
        end = mid
        least = part + 1
        most = part + 1
        if part < p:
            for i in range(n):
                C[i, most] = C[F[i], part] / most
        else:
            begin = mid + part - p
            end = mid + part - p + 1
            least = 1
            most = p
        for e in range(begin, end):
            for k in range(least, most + 1):
                _coefficient(ops[e, 0], C, ops[e, 1], ops[e, 2], n + 1 + e - lo, nums[e, 0], k)


@inner
def horner(C, row, s, p):
    """Value at s of a row of coefficients up to order p >= 1: even and odd powers apart, as one
    chain would wait for itself."""
    y = C[row, p]
    w = C[row, p - 1]
    z = s * s
    for k in range(p - 2, 0, -2):
        y = y * z + C[row, k]
        w = w * z + C[row, k - 1]
    return y * s + w if p % 2 else (y * z + C[row, 0]) + w * s
