"""Taylor coefficients of a traced program: an interpreter, compiled once for all programs.

A program is a list of operations ops[e] = (code, a, b), nums[e] = (c, d) (see opcodes), lo <= e <
hi. Operation e computes row n + 1 + e - lo of a table whose rows 0 .. n - 1 are the state and whose
row n is the time. `series` fills a table (rows, p + 1) of normalised Taylor coefficients of the
solution of x_i' = (row F[i]); `point` fills columns with the values at single points.
Source of the recurrences: Jorba & Zou, Experimental Mathematics 14 (2005), proposition 2.1.
"""

from math import atan, cos, cosh, exp, log, sin, sinh, tanh

import numpy as np

from nsbench.compilation.decorators import inner_kernel, summing_kernel
from nsbench.solvers.event_driven.filippov.kernels import opcodes as op
from nsbench.solvers.event_driven.filippov.kernels.loop_state import (
    ALL_END,
    BEGIN,
    LEADING_END,
)


@inner_kernel
def power(a, alpha):
    """Return a ** alpha for a > 0, with the square root's own rounding for alpha = 1/2."""
    return np.sqrt(a) if alpha == 0.5 else a**alpha


@inner_kernel
def head(code, u, v, c, d):
    """Return the value of an operation without partner, or of the first of a pair, at the values u,
    v of its rows and with its constants c, d."""
    if code == op.ADD:
        return u + v
    if code == op.SUB:
        return u - v
    if code == op.MUL:
        return u * v
    if code == op.AFFINE:
        return c * u + d
    if code == op.SQR:
        return u * u
    if code == op.DIV:
        return u / v
    if code == op.RDIV:
        return c / u
    if code == op.SIN:
        return sin(u)
    if code == op.EXP:
        return exp(u)
    if code == op.POW:
        return power(u, c)
    if code == op.LOG:
        return log(u) if u > 0.0 else np.nan
    if code == op.ATAN:
        return atan(u)
    if code == op.TANH:
        return tanh(u)
    if code == op.SINH:
        return sinh(u)
    return c  # CONST


@inner_kernel
def partner(code, u, y):
    """Return the value of the second of a pair, from that of its row, u, and of the first, y."""
    if code == op.SIN:
        return cos(u)
    if code == op.SINH:
        return cosh(u)
    return 1.0 - y * y


@inner_kernel
def point(ops, nums, first, n, V, many):
    """Fill V[n + 1 :, :many] with the values at the states V[:n, :many] and the times V[n, :many]
    of `many` points. first (3,): as in `series`."""
    lo = first[BEGIN]
    for e in range(lo, first[ALL_END]):
        code = ops[e, 0]
        u = ops[e, 1]
        v = ops[e, 2]
        row = n + 1 + e - lo
        if code == op.COS or code == op.COSH or code == op.SECH2:
            continue
        for k in range(many):
            V[row, k] = head(code, V[u, k], V[v, k], nums[e, 0], nums[e, 1])
            if code == op.SIN or code == op.SINH or code == op.TANH:
                V[row + 1, k] = partner(code, V[u, k], V[row, k])


@summing_kernel
def _product(C, u, v, first, k):
    """Return the sum over i = first .. k of u_i v_(k-i), for rows u, v."""
    s = 0.0
    for i in range(first, k + 1):
        s += C[u, i] * C[v, k - i]
    return s


@summing_kernel
def _weighted(C, u, v, last, k):
    """Return the sum over i = 1 .. last of i u_i v_(k-i), for rows u, v; at last = k this is
    coefficient k - 1 of u' v."""
    s = 0.0
    for i in range(1, last + 1):
        s += i * C[u, i] * C[v, k - i]
    return s


@inner_kernel
def coefficient(code, C, u, v, y, w, k):
    """Set coefficient k >= 1 of row y = op(u, v) with constant w; of a pair, that of the next row
    too."""
    if code == op.ADD:
        C[y, k] = C[u, k] + C[v, k]
    elif code == op.SUB:
        C[y, k] = C[u, k] - C[v, k]
    elif code == op.AFFINE:
        C[y, k] = w * C[u, k]
    elif code == op.MUL:
        C[y, k] = _product(C, u, v, 0, k)
    elif code == op.SQR:
        s = 0.0
        for i in range((k + 1) // 2):
            s += C[u, i] * C[u, k - i]
        C[y, k] = 2.0 * s if k % 2 else 2.0 * s + C[u, k // 2] * C[u, k // 2]
    elif code == op.DIV:
        C[y, k] = (C[u, k] - _product(C, v, y, 1, k)) / C[v, 0]
    elif code == op.RDIV:
        C[y, k] = -_product(C, u, y, 1, k) / C[u, 0]
    elif code == op.EXP:
        C[y, k] = _weighted(C, u, y, k, k) / k
    elif code == op.POW:
        s = 0.0
        for i in range(k):
            s += (w * (k - i) - i) * C[u, k - i] * C[y, i]
        C[y, k] = s / (k * C[u, 0])
    elif code == op.LOG or code == op.ATAN:
        C[y, k] = (C[u, k] - _weighted(C, y, v, k - 1, k) / k) / C[v, 0]
    elif code == op.SIN:
        C[y + 1, k] = -_weighted(C, u, y, k, k) / k
        C[y, k] = _weighted(C, u, y + 1, k, k) / k
    elif code == op.SINH:
        C[y + 1, k] = _weighted(C, u, y, k, k) / k
        C[y, k] = _weighted(C, u, y + 1, k, k) / k
    elif code == op.TANH:
        C[y, k] = _weighted(C, u, y + 1, k, k) / k
        C[y + 1, k] = -_product(C, y, y, 0, k)
    elif code == op.CONST:
        C[y, k] = 0.0  # the second of a pair is computed with the first


@inner_kernel
def series(ops, nums, first, F, n, p, C):
    """Fill the table C (rows, >= p + 1) with coefficients 0 .. p of state and operations, from the
    state C[:n, 0] and the time C[n, 0].

    first (3,): where the operations of the program lie, as a row of Programs.first. The leading
    ones give the derivatives, rows F (n,), and go order by order; the others follow one by one when
    the state is known.
    """
    lo = first[BEGIN]
    mid = first[LEADING_END]
    hi = first[ALL_END]
    for k in range(1, p + 1):
        C[n, k] = 0.0
    C[n, 1] = 1.0
    for e in range(lo, hi):
        code = ops[e, 0]
        row = n + 1 + e - lo
        if code == op.COS or code == op.COSH or code == op.SECH2:
            continue
        C[row, 0] = head(code, C[ops[e, 1], 0], C[ops[e, 2], 0], nums[e, 0], nums[e, 1])
        if code == op.SIN or code == op.SINH or code == op.TANH:
            C[row + 1, 0] = partner(code, C[ops[e, 1], 0], C[row, 0])
    # automatic differentiation, order by order: coefficient k of x' gives coefficient k + 1 of x.
    # One loop for both groups of operations, so that the branches below are compiled once
    for part in range(p + hi - mid):
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
                coefficient(ops[e, 0], C, ops[e, 1], ops[e, 2], n + 1 + e - lo, nums[e, 0], k)


@inner_kernel
def horner(C, row, s, p):
    """Return the value at s of a row of coefficients up to order p >= 1 (Horner's scheme, even and
    odd powers apart: one chain of operations would wait for itself)."""
    y = C[row, p]
    w = C[row, p - 1]
    z = s * s
    for k in range(p - 2, 0, -2):
        y = y * z + C[row, k]
        w = w * z + C[row, k - 1]
    return y * s + w if p % 2 else (y * z + C[row, 0]) + w * s
