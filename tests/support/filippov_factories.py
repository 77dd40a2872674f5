"""Short factories and array helpers, from which Filippov systems with closed forms are written."""

import numpy as np
from scipy.optimize import brentq


def drift(f):
    """A factory from a lambda (xp, t, x) or (xp, t, x, s)."""
    return lambda xp: lambda *a: f(xp, *a)


def constant(*v):
    return drift(lambda xp, t, x: xp.array(v) + 0.0 * x)


def entry(i):
    return drift(lambda xp, t, x: x[i : i + 1])


def root(f, a, b):
    return brentq(f, a, b, xtol=1e-16, rtol=1e-15)


def stack(*columns):
    return np.stack(np.broadcast_arrays(*columns), 1)


states = drift(lambda xp, t, x: x + 0.0)


still = drift(lambda xp, t, x: 0.0 * x)
