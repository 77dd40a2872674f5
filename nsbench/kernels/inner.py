"""How functions are compiled that only compiled functions call: without entries from Python and C, in less time."""
import numba

inner = numba.njit(cache=True, error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True)
summing = numba.njit(cache=True, error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True,
                     fastmath={"reassoc", "contract"})        # dot products may be summed in lanes
