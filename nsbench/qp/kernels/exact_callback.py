"""kernels.qp as a C function: exact to rounding and basic, best for few rows."""

from nsbench.compilation.decorators import cfunc
from nsbench.qp.kernels import active_set
from nsbench.qp.kernels.dispatch import EXACT


@cfunc(EXACT, cache=True, error_model="numpy")
def solve_exact(ptr, cols, tptr, trow, tpos, order, vals, q, guess, scale, mu, d, work):
    """Fills mu (m,), d (n,) and work: code, rounds."""
    got, way, work[0], work[1] = active_set.solve(
        (ptr, cols, tptr, trow, tpos, order), vals, q, guess, scale
    )
    for k in range(mu.size):
        mu[k] = got[k]
    for c in range(d.size):
        d[c] = way[c]
