"""kernels.qp as a C function: exact to rounding and basic, best for few rows."""
from numba import cfunc

from nsbench.kernels import qp
from nsbench.kernels.least import EXACT


@cfunc(EXACT, cache=True, error_model="numpy")
def exact(ptr, cols, tptr, trow, tpos, order, vals, q, guess, scale, mu, d, work):
    """Fills mu (m,), d (n,) and work: code, rounds."""
    got, way, work[0], work[1] = qp.solve((ptr, cols, tptr, trow, tpos, order), vals, q, guess, scale)
    for k in range(mu.size):
        mu[k] = got[k]
    for c in range(d.size):
        d[c] = way[c]
