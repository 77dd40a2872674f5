"""First root of a polynomial on [-1, 1], with an error bound, by bisection of the interval.

On each part the polynomial is expanded about the middle (Taylor shift); bounds from its
coefficients show that it stays positive there, or that it is monotone, so that the ends decide.
"""

from math import comb

import numpy as np

from nsbench.compilation.decorators import inner_kernel

CLEAR = 0
FOUND = 1
UNCLEAR = 2
DEEP = 60  # halvings of [-1, 1] before a place counts as unclear
DEGREE = 40  # largest degree
NEWTON_STEPS = 200  # within a bracket that at least halves every other time
# binomial coefficients (k, j)
CHOOSE = np.array([[float(comb(k, j)) for j in range(DEGREE + 1)] for k in range(DEGREE + 1)])


@inner_kernel
def shifted(C, row, p, middle, radius, out, to):
    """Fill out[to, :p + 1] with the coefficients in s of u(middle + radius s), u = C[row], by the
    binomial theorem."""
    if middle == 0.0:
        scale = 1.0
        for k in range(p + 1):
            out[to, k] = C[row, k] * scale
            scale *= radius
        return
    for k in range(p + 1):
        out[to, k] = 0.0
    scale = 1.0
    for k in range(p + 1):
        term = C[row, k] * scale
        for j in range(k + 1):
            out[to, j] += CHOOSE[k, j] * term
        scale *= middle
    scale = 1.0
    for k in range(1, p + 1):
        scale *= radius / middle
        out[to, k] *= scale


@inner_kernel
def _zero(C, row, p, lo, hi):
    """Return the zero of the polynomial C[row] in [lo, hi], where it falls monotonically, by
    Newton's method within a bracket."""
    s = 0.5 * (lo + hi)
    for _ in range(NEWTON_STEPS):
        y = C[row, p]
        d = 0.0
        for k in range(p - 1, -1, -1):
            d = d * s + y
            y = y * s + C[row, k]
        if y > 0.0:
            lo = s
        else:
            hi = s
        step = s - y / d if d != 0.0 else 0.5 * (lo + hi)
        new = step if lo < step < hi else 0.5 * (lo + hi)
        if abs(new - s) <= 1e-16 or hi - lo <= 1e-16:
            return new
        s = new
    return s


@inner_kernel
def first_fall(C, row, p, error, stack, work):
    """Find the first zero on [-1, 1] of u = C[row], which is known, and positive at -1, up to
    `error`.

    Returns the code and the place. CLEAR: u stays above `error`. FOUND: it falls monotonically from
    above to below zero there. UNCLEAR: a minimum near zero that cannot be distinguished from a
    touch. stack (>= 2 DEEP + 4, 2), work
    (1, p + 1): scratch.
    """
    # bisection from left to right, by a stack of intervals
    top = 1
    stack[0, 0] = -1.0
    stack[0, 1] = 1.0
    while top > 0:
        top -= 1
        lo = stack[top, 0]
        hi = stack[top, 1]
        middle = 0.5 * (lo + hi)
        radius = 0.5 * (hi - lo)
        shifted(C, row, p, middle, radius, work, 0)
        swing = 0.0
        bend = 0.0
        for k in range(1, p + 1):
            swing += abs(work[0, k])
            if k > 1:
                bend += k * abs(work[0, k])
        if work[0, 0] - swing > error:
            continue
        steep = abs(work[0, 1]) - bend
        if steep > 2.0 * error:  # certainly monotone: the ends decide
            left = 0.0
            right = 0.0
            for k in range(p + 1):
                left += -work[0, k] if k % 2 else work[0, k]
                right += work[0, k]
            if work[0, 1] > 0.0:
                if left > error or (lo == -1.0 and left > 0.0):
                    continue
                return UNCLEAR, lo
            if right > error:
                continue
            if right < -error:
                return FOUND, _zero(C, row, p, lo, hi) if left > 0.0 else lo
            if right <= 0.0 and steep > 1e3 * error:
                return FOUND, _zero(C, row, p, lo, hi) if left > 0.0 else lo
            if hi == 1.0:  # the next step finds it, or the next function
                if right > 0.0 and steep > 1e3 * error:
                    continue
                return UNCLEAR, hi
            if steep > 1e3 * error:
                continue  # falls on, through zero, in the next part
            return UNCLEAR, hi
        if radius < 2.0**-DEEP * 4.0 or swing <= error or top + 2 > stack.shape[0]:
            return UNCLEAR, lo
        stack[top, 0] = middle
        stack[top, 1] = hi
        stack[top + 1, 0] = lo
        stack[top + 1, 1] = middle
        top += 2
    return CLEAR, np.nan
