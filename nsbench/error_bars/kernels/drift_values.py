"""Drift at many states, by the function pointer of a compiled drift."""

from collections.abc import Callable

import numpy as np

from nsbench.compilation.decorators import njit


@njit(cache=True, error_model="numpy")
def drift_values(drift: Callable, t: np.ndarray, X: np.ndarray, out: np.ndarray) -> None:
    """Fill out (K, n) with f(t, x) at the K times t and states X (K, n).

    drift: pointer to a function (t, x, out).
    """
    for k in range(len(t)):
        drift(t[k], X[k], out[k])
