"""Drift of a case as the error bars evaluate it: compiled where numba can, else in numpy."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from nsbench.compilation.case_functions import drift_function
from nsbench.compilation.factories import CompileError, as_numpy
from nsbench.error_bars.unit_gradients import for_kernel


class Drift:
    """The drift (T / L) f(t0 + T t, L x) at one state or at many, of ``drift(xp) -> (t, x)``.

    n: coordinates. origin, time, length: t0, T and L, of units in which the drift is not written.
    It is compiled as the user wrote it, as for the runs of the case, and scaled where it is
    evaluated: one compilation serves both. units: origin, time, length. factory: as the user wrote
    it. function: the drift for kernels. is_compiled: could numba compile it?
    """

    def __init__(
        self, drift: Callable, n: int, origin: float = 0.0, time: float = 1.0, length: float = 1.0
    ):
        self.units = origin, time, length
        self.factory = drift
        # as the user wrote it, and how to compile it
        self.function = drift_function(drift, n)
        try:
            self._pointer = self.function.pointer()
        except CompileError:
            self._in_numpy = as_numpy(drift)
            self.is_compiled = False
            return
        from numba import float64, typeof

        from nsbench.error_bars.kernels.drift_values import drift_values

        # the compiled kernel itself: numba's dispatcher takes longer over a pointer than the drift
        given = typeof(self._pointer), *(float64,) * 3, float64[::1], *(float64[:, ::1],) * 2
        self._values = drift_values.compile(given)
        self.is_compiled = True

    def __call__(self, t: float, x: np.ndarray) -> np.ndarray:
        """Return f(t, x) (n,) at one state."""
        return self.at(np.array([t], float), x[None])[0]

    def at(self, t: np.ndarray, X: np.ndarray) -> np.ndarray:
        """Return (K, n) the drift at the times t (K,) and states X (K, n)."""
        out = np.empty(X.shape)
        if self.is_compiled:
            times = np.ascontiguousarray(t, float)
            self._values(self._pointer, *self.units, times, for_kernel(X), out)
            return out
        origin, time, length = self.units
        for k, (s, x) in enumerate(zip(t, X, strict=True)):
            out[k] = np.ravel(self._in_numpy(origin + time * float(s), length * x))
        out *= time / length
        return out
