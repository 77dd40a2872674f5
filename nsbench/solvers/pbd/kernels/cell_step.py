"""The steps of kernels.pbd_packed besides its sweep, over the particles lo, ..., hi - 1 of the
store."""

import numpy as np

from nsbench.compilation.decorators import njit


@njit(cache=True)
def drift(x, y, spot, v, label, h, dim, lo, hi):
    """One step of Euler from x (by label) to y. Returns the largest squared distance from spot, NaN
    if not all is finite."""
    far = 0.0
    good = True
    for s in range(lo, hi):
        g = 0.0
        for c in range(dim):
            a = x[label[s] * dim + c] + h * v[label[s] * dim + c]
            y[s * dim + c] = a
            good = good and abs(a) < 1e150
            g += (a - spot[s * dim + c]) ** 2
        far = max(far, g)
    return far if good else np.nan


@njit(cache=True)
def farthest(y, base, dim, lo, hi):
    """The largest squared distance from base."""
    far = 0.0
    for s in range(lo, hi):
        g = 0.0
        for c in range(s * dim, (s + 1) * dim):
            g += (y[c] - base[c]) ** 2
        far = max(far, g)
    return far


@njit(cache=True)
def settle(x, y, v, reac, label, h, dim, lo, hi):
    """What the sweep moved since the drift is reaction; x: positions by label, before the step and
    now."""
    for s in range(lo, hi):
        for c in range(dim):
            e = label[s] * dim + c
            reac[s * dim + c] += y[s * dim + c] - (x[e] + h * v[e])
            x[e] = y[s * dim + c]
