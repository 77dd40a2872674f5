"""What a family gives as functions of time: walls one after the other, their speeds, smooth gaps
and derivatives."""

from __future__ import annotations

import functools

import numpy as np

from nsbench.compilation.factories import as_jax, as_numpy
from nsbench.problem import Smooth


def concatenate_curves(parts):
    """One factory ``(xp) -> (t) -> flat array`` for arrays and factories one after the other; None
    if nothing moves."""
    if not any(callable(p) for p in parts):
        return None
    key = tuple(map(id, parts))
    if key not in _chains:  # the same factory each time: what is compiled for it serves again
        _chains[key] = parts, _chain(parts)
    return _chains[key][1]


_chains: dict = {}


def _chain(parts):
    def leaf(part):
        def make(xp):
            if callable(part):
                inner = part(xp)
                return lambda t: inner(t).ravel()
            still = np.array(part).ravel()
            return lambda t: still

        return make

    def join(a, b):
        def make(xp):
            fa = a(xp)
            fb = b(xp)
            return lambda t: xp.concatenate((fa(t), fb(t)))

        return make

    return functools.reduce(join, map(leaf, parts))


_derivatives: dict = {}


def time_derivative(factory):
    """d/dt of ``factory(xp) -> (t)`` by JAX, as a numpy function; compiled once."""
    if factory not in _derivatives:
        import jax

        f = as_jax(factory)
        d = jax.jit(lambda t: jax.jvp(f, (t,), (1.0,))[1])
        _derivatives[factory] = lambda t: np.asarray(d(float(t)))
    return _derivatives[factory]


class SmoothRows:
    """g, gradient and rate of a Smooth family as numpy functions."""

    def __init__(self, family: Smooth, n: int):
        self._family = family
        self._n = n
        self.g = lambda t, x, f=as_numpy(family.g): np.asarray(f(t, x), float)
        self.m = len(self.g(0.0, np.full(n, 0.37)))
        self._gradient = as_numpy(family.gradient) if family.gradient else None
        self._rate = as_numpy(family.rate) if family.rate else None

    def _jax(self, argnum):
        import jax

        f = as_jax(self._family.g)
        d = jax.jit(jax.jacfwd(f, argnums=argnum))
        return lambda t, x: np.asarray(d(float(t), x))

    def gradient(self, t, x):
        """(m, n)."""
        if self._gradient is None:
            self._gradient = self._jax(1)
        return np.asarray(self._gradient(t, x), float)

    def rate(self, t, x):
        """(m,)."""
        if self._rate is None:
            self._rate = self._jax(0)
        return np.asarray(self._rate(t, x), float)
