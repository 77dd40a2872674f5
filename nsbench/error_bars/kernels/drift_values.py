"""Drift at many states, by the function pointer of a compiled drift."""

from collections.abc import Callable

import numpy as np

from nsbench.compilation.decorators import njit


@njit(cache=True, error_model="numpy")
def drift_values(
    drift: Callable,
    origin: float,
    time: float,
    length: float,
    t: np.ndarray,
    X: np.ndarray,
    out: np.ndarray,
) -> None:
    """Fill out (K, n) with (T / L) f(t0 + T t, L x) at the K times t and states X (K, n).

    drift: pointer to a function (t, x, out) that fills out with f(t, x), in the units of the user.
    origin, time, length: t0, T and L, of the units of t and X.
    """
    rate = time / length
    x = np.empty(X.shape[1])
    for k in range(len(t)):
        for c in range(len(x)):
            x[c] = length * X[k, c]
        drift(origin + time * t[k], x, out[k])
        for c in range(len(x)):
            out[k, c] *= rate
