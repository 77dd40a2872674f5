"""The numba decorators of this package: importing them configures numba's cache.

`njit` and `cfunc` are numba's own. Every kernel takes them from here, so that numba knows where to
store kernels, and when they are current, before it compiles one (nsbench.compilation.numba_cache).

Functions that only compiled functions call take `inner_kernel`, `fused_kernel`, `summing_kernel` or
`inlined`: without entries from Python and C they compile in less time. They are not stored on disk
themselves: their callers are, with their code in them. Other things cost time to compile: arrays
assigned to arrays (the message on shapes alone is put together by 25 functions on strings),
literals as arguments (one version of the function for each), functions of numpy on arrays. Hence
`one`, and loops.
"""

import numba
import numpy as np
from numba import cfunc, njit

from nsbench.compilation import numba_cache  # noqa: F401  (configures numba)

__all__ = [
    "cfunc",
    "fused_kernel",
    "fused_njit",
    "inlined",
    "inner_kernel",
    "njit",
    "one",
    "summing_kernel",
]

inner_kernel = numba.njit(error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True)
# dot products may be summed in lanes
summing_kernel = numba.njit(
    error_model="numpy",
    no_cpython_wrapper=True,
    no_cfunc_wrapper=True,
    fastmath={"reassoc", "contract"},
)
inlined = numba.njit(error_model="numpy", inline="always")
# LLVM inlines these two into their caller, where reference counts of borrowed arrays vanish; the
# second can be called from Python too
fused_kernel = numba.njit(
    error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True, forceinline=True
)
fused_njit = numba.njit(cache=True, error_model="numpy", forceinline=True)


@inner_kernel
def one() -> int:
    """Return 1 that is no literal."""
    return np.int64(1)
