"""Where a polynomial first falls below a level: enclosures on intervals that are halved until they
decide.

Coefficients c (deg + 1,) in s; on an interval the polynomial is developed about the middle, where
the sum of the other terms' sizes bounds what it does. No passage is missed between nodes: there are
none.
"""

import numpy as np

from nsbench.compilation.decorators import inner_kernel

NARROW = 2.0**-44  # of [0, 1]: below, times cannot be told apart
# touches per step: a function that reaches zero at this pace at the end of a step crosses there
STEEP = 100.0
ENDS = 1e-2  # of a touch: zero, up to rounding
MOST = 4000  # intervals looked at: far beyond what a polynomial with distinct roots takes


@inner_kernel
def value(c, deg, s):
    v = c[deg]
    for j in range(deg - 1, -1, -1):
        v = v * s + c[j]
    return v


@inner_kernel
def slope(c, deg, s):
    v = deg * c[deg]
    for j in range(deg - 1, 0, -1):
        v = v * s + j * c[j]
    return v


@inner_kernel
def root(c, deg, level, lo, hi):
    """A root of c - level in [lo, hi], where it is above at lo and below at hi: Newton's steps,
    kept in the bracket."""
    s = hi
    for _ in range(200):
        v = value(c, deg, s) - level
        if v > 0.0:
            lo = s
        elif v < 0.0:
            hi = s
        else:
            return s
        d = slope(c, deg, s)
        new = s - v / d
        if not (lo < new < hi):
            new = 0.5 * (lo + hi)
        if new == s or hi - lo <= 2e-16 * hi:
            return new
        s = new
    return s


@inner_kernel
def first_descent(c, deg, level, lo, hi, b):
    """The smallest s in [lo, hi] with c(s) < level, up to rounding; -1.0 if there is none. b (deg +
    1,): scratch."""
    spread = 0.0
    power = 1.0
    for j in range(1, deg + 1):
        power *= hi
        spread += abs(c[j]) * power
    if c[0] - spread >= level:
        return -1.0
    left = np.empty(128)
    right = np.empty(128)
    left[0] = lo
    right[0] = hi
    top = 1
    looked = 0
    while top > 0:
        top -= 1
        a = left[top]
        z = right[top]
        looked += 1
        mid = 0.5 * (a + z)
        r = 0.5 * (z - a)
        for j in range(deg + 1):
            b[j] = c[j]
        for i in range(deg):  # Taylor shift by repeated synthetic division
            for j in range(deg - 1, i - 1, -1):
                b[j] += mid * b[j + 1]
        spread = 0.0
        bend = 0.0
        power = 1.0
        for j in range(1, deg + 1):
            if j > 1:
                bend += j * abs(b[j]) * power
            power *= r
            spread += abs(b[j]) * power
        if b[0] - spread >= level:
            continue
        if value(c, deg, a) < level:
            return a
        if deg < 1:
            continue
        if abs(b[1]) > bend or r < NARROW or looked > MOST:
            if value(c, deg, z) < level:
                return root(c, deg, level, a, z)
            continue
        left[top] = mid
        right[top] = z
        left[top + 1] = a
        right[top + 1] = mid
        top += 2
    return -1.0


@inner_kernel
def next_crossing(c, deg, armed, level, band, touch, hi, b, d):
    """First event of one function on [0, hi]: (s or -1.0, armed afterwards, touched).

    An armed function fires where it crosses zero on the way to -touch; another fires where it falls
    below `level`, and is armed once it exceeds `band`. touched: it went below zero, and less than
    `touch` below.
    """
    start = 0.0
    if not armed:
        fall = first_descent(c, deg, level, 0.0, hi, b)
        for j in range(deg + 1):
            d[j] = -c[j]
        rise = first_descent(d, deg, -band, 0.0, hi, b)
        if rise < 0.0 or 0.0 <= fall <= rise:
            return fall, False, False
        start = rise
    deep = first_descent(c, deg, -touch, start, hi, b)
    if (
        deep < 0.0
        and hi == 1.0
        and value(c, deg, 1.0) < ENDS * touch
        and slope(c, deg, 1.0) < -STEEP * touch
    ):
        return (root(c, deg, 0.0, start, 1.0) if value(c, deg, 1.0) < 0.0 else 1.0), True, False
    if deep < 0.0:
        return -1.0, True, first_descent(c, deg, -1e-3 * touch, start, hi, b) >= 0.0
    if (
        value(c, deg, start) <= 0.0
    ):  # by rounding, at the start of a step: it may rise before it falls
        for j in range(deg + 1):
            d[j] = -c[j]
        rise = first_descent(d, deg, -touch, start, deep, b)
        if rise < 0.0:
            return start, True, False
        start = rise
    return root(c, deg, 0.0, start, deep), True, False
