"""Maximum norm of a vector."""

import numpy as np

from nsbench.compilation.decorators import inner_kernel


@inner_kernel
def largest(x: np.ndarray) -> float:
    """Return max |x_i| of x (n,), 0 if it is empty."""
    m = 0.0
    for v in x:
        m = max(m, abs(v))
    return m
