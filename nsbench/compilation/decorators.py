"""How functions are compiled that only compiled functions call: without entries from Python and C,
in less time.

They are not kept on disk: who calls them is, with their code in it. Beside that, what costs time to
compile: arrays assigned to arrays (their message on shapes is put together by 25 functions on
strings), literals as arguments (a version of the function for each), functions of numpy on arrays.
Hence `one`, and loops.
"""

import numba
import numpy as np

from nsbench.compilation import numba_setup  # noqa: F401  (before numba keeps anything)

inner_kernel = numba.njit(error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True)
summing_kernel = numba.njit(
    error_model="numpy",
    no_cpython_wrapper=True,
    no_cfunc_wrapper=True,
    fastmath={"reassoc", "contract"},
)  # dot products may be summed in lanes


@inner_kernel
def one():
    """1 that is no literal."""
    return np.int64(1)


inlined = numba.njit(error_model="numpy", inline="always")
