"""Drift of a case as the error bars evaluate it: compiled where numba can, else in numpy."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from nsbench.compilation.factories import CompileError, as_numpy, rhs_cfunc
from nsbench.error_bars.unit_gradients import for_kernel


class Drift:
    """The drift f(t, x) of ``drift(xp) -> (t, x)`` in n coordinates, at one state or at many.

    is_compiled: could numba compile it?
    """

    def __init__(self, drift: Callable, n: int):
        try:
            self._pointer = rhs_cfunc(drift, n)
        except CompileError:
            self._in_numpy = as_numpy(drift)
            self.is_compiled = False
            return
        self.is_compiled = True
        from numba import float64, typeof

        from nsbench.error_bars.kernels.drift_values import drift_values

        # the compiled kernel itself: numba's dispatcher takes longer over a pointer than the drift
        states = float64[:, ::1]
        self._values = drift_values.compile((typeof(self._pointer), float64[::1], states, states))

    def __call__(self, t: float, x: np.ndarray) -> np.ndarray:
        """Return f(t, x) (n,) at one state."""
        return self.at(np.array([t], float), x[None])[0]

    def at(self, t: np.ndarray, X: np.ndarray) -> np.ndarray:
        """Return (K, n) the drift at the times t (K,) and states X (K, n)."""
        out = np.empty(X.shape)
        if self.is_compiled:
            self._values(self._pointer, np.ascontiguousarray(t, float), for_kernel(X), out)
            return out
        for k, (s, x) in enumerate(zip(t, X, strict=True)):
            out[k] = np.ravel(self._in_numpy(float(s), x))
        return out
