"""Evaluate moving constraints: b(t) of walls, anchors(t), Smooth g(t, x), and time derivatives.

Curves are those of walls (the right-hand sides of rows) and of anchors.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import numpy as np

from nsbench.compilation.factories import as_jax, as_numpy
from nsbench.problem import Smooth


def concatenate_curves(parts: list) -> Callable | None:
    """Concatenate arrays and factories of curves into one factory ``(xp) -> (t) -> flat array``.

    Returns None if nothing moves.
    """
    if not any(callable(p) for p in parts):
        return None
    key = tuple(map(id, parts))
    if key not in _chains:  # the same factory each time: what is compiled for it serves again
        _chains[key] = parts, _chain(parts)
    return _chains[key][1]


_chains: dict = {}


def _chain(parts):
    """Build the factory that concatenates the parts, at least one of which moves."""

    def leaf(part: Callable | np.ndarray) -> Callable:
        def make(xp: Any) -> Callable:
            if callable(part):
                inner = part(xp)
                return lambda t: xp.asarray(inner(t)).ravel()
            still = np.array(part).ravel()
            return lambda t: still

        return make

    def join(a: Callable, b: Callable) -> Callable:
        def make(xp: Any) -> Callable:
            fa = a(xp)
            fb = b(xp)
            return lambda t: xp.concatenate((fa(t), fb(t)))

        return make

    return functools.reduce(join, map(leaf, parts))


_derivatives: dict = {}


def time_derivative(factory: Callable) -> Callable:
    """Differentiate ``factory(xp) -> (t)`` in time by JAX.

    Returns a numpy function, compiled once.
    """
    if factory not in _derivatives:
        import jax

        f = as_jax(factory)
        d = jax.jit(lambda t: jax.jvp(f, (t,), (1.0,))[1])
        _derivatives[factory] = lambda t: np.asarray(d(float(t)))
    return _derivatives[factory]


class SmoothRows:
    """Evaluate g, gradient and rate of a Smooth family as numpy functions of (t, x)."""

    def __init__(self, family: Smooth, n: int):
        self._family = family
        self._n = n
        self.g = lambda t, x, f=as_numpy(family.g): np.asarray(f(t, x), float)
        self.m = len(self.g(0.0, np.full(n, 0.37)))
        self._gradient = as_numpy(family.gradient) if family.gradient else None
        self._rate = as_numpy(family.rate) if family.rate else None

    def _jax(self, argnum):
        """Return the Jacobian of g in argument `argnum` by JAX."""
        import jax

        f = as_jax(self._family.g)
        d = jax.jit(jax.jacfwd(f, argnums=argnum))
        return lambda t, x: np.asarray(d(float(t), x))

    def gradient(self, t: float, x: np.ndarray) -> np.ndarray:
        """Return the gradients (m, n) of g at (t, x)."""
        if self._gradient is None:
            self._gradient = self._jax(1)
        return np.asarray(self._gradient(t, x), float)

    def rate(self, t: float, x: np.ndarray) -> np.ndarray:
        """Return the partial derivatives (m,) of g in time at (t, x)."""
        if self._rate is None:
            self._rate = self._jax(0)
        return np.asarray(self._rate(t, x), float)
