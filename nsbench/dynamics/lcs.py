"""Linear complementarity systems: right-hand sides, consistent starts, uniqueness of the motion.

    x' = A x + B lam + u(t),    0 <= lam  _|_  w = C x + D lam + q(t) >= 0

All methods for such systems share these functions.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations
from typing import Any

import numpy as np

from nsbench.case import Case
from nsbench.compilation.factories import as_numpy, without_compilation
from nsbench.problem import LCS

MINORS = 10  # rows whose principal minors are all looked at
FEW = 8  # rows up to which one complementarity problem is solved without compiling the solver
_drifts: dict = {}  # by id; the system is kept beside it, so that the id stays its own


def drift_of(p: LCS) -> Callable:
    """Return the factory of the drift A x + u(t), the same object for one system each time.

    What is compiled for the drift is stored under that object and so serves again.
    """
    if id(p) not in _drifts:
        _drifts[id(p)] = p, _make(p)
    return _drifts[id(p)][1]


def _make(p):
    """Build the factory of A x + u(t); without an input u, of A x."""
    A = np.array(p.A)

    def still(xp: Any) -> Callable:
        a = A if xp.__name__ == "numpy" else xp.asarray(A)

        def f(t: float, x: np.ndarray) -> np.ndarray:
            return a @ x

        return f

    def driven(xp: Any) -> Callable:
        a = A if xp.__name__ == "numpy" else xp.asarray(A)
        u = p.u(xp)

        def f(t: float, x: np.ndarray) -> np.ndarray:
            return a @ x + xp.asarray(u(t))

        return f

    return still if p.u is None else driven


def inputs(p: LCS) -> tuple[Callable, Callable]:
    """Return the inputs u (n,) and q (m,) as numpy functions of time; zeros where there is none."""
    zero_u = np.zeros(p.B.shape[0])
    zero_q = np.zeros(p.B.shape[1])
    return _floats(p.u) if p.u else lambda t: zero_u, _floats(p.q) if p.q else lambda t: zero_q


def _floats(factory):
    """Return a factory's function in numpy, with values of type float."""
    f = as_numpy(factory)
    return lambda t: np.asarray(f(t), float)


def inconsistent(case: Case) -> str | None:
    """Explain why no motion without a jump starts at x0, as a sentence; None if lambda(t0) exists.

    The start is consistent if the complementarity problem 0 <= lam _|_ C x0 + D lam + q(t0) >= 0
    has a solution, which Lemke's method decides.
    """
    from nsbench.lcp import lemke

    p = case.problem
    t0 = float(case.t[0])
    q = inputs(p)[1](t0)
    v = p.C @ case.x0 + q
    if not np.all(np.isfinite(v)):
        return f"w is not finite at the start of {case.key}: {v}."
    size = np.abs(p.C) @ np.abs(case.x0) + np.abs(q)
    v = np.where(
        np.abs(v) <= 1e-9 * size, np.maximum(v, 0.0), v
    )  # the rounding of whoever made the start
    solve, scales = (
        without_compilation(f) if len(v) <= FEW else f for f in (lemke.solve, lemke.scales)
    )
    D = np.array(p.D)
    with np.errstate(all="ignore"):
        if solve(D, v, *scales(D), np.zeros(len(v), np.bool_), np.zeros(len(v)), np.zeros(len(v)))[
            0
        ]:
            return None
    row = int(np.argmin(v))
    return (
        f"The start of {case.key} is inconsistent: no lambda >= 0 makes w = C x0 + D lambda + "
        f"q(t0) non-negative and "
        f"complementary to it (C x0 + q(t0) is {v[row]:.6g} in row {row}); the state would have "
        f"to jump, for which "
        "a linear complementarity system states no law."
    )


def certainly_unique(M: np.ndarray, G: np.ndarray) -> bool:
    """Is G lam the same for all solutions of every complementarity problem of the matrix M?

    M (m, m), G (n, m). Yes if all principal minors are positive (then lam itself is unique), or if
    M is positive semidefinite and G vanishes where its symmetric part does (Cottle, Pang & Stone
    1992, theorems 3.3.7 and 3.1.7). Minors are computed for up to 10 rows. False means that
    uniqueness is not certain.
    """
    from nsbench.lcp import lemke

    m = len(M)
    if m == 0:
        return True
    a, b = lemke.scales(M)
    S = a[:, None] * M * b
    # P-matrix test: all principal minors of the scaled matrix are positive.
    if m <= MINORS and all(
        np.linalg.det(S[np.ix_(i, i)]) > 1e-10
        for k in range(1, m + 1)
        for i in combinations(range(m), k)
    ):
        return True
    # Else M must be positive semidefinite, with G zero on the kernel of its symmetric part.
    s = np.sqrt(np.where(np.diag(M) > 0.0, np.diag(M), 1.0))
    sym = 0.5 * (M + M.T) / s[:, None] / s
    values, vectors = np.linalg.eigh(sym)
    top = max(np.abs(values).max(), 1e-300)
    if values[0] < -1e-12 * max(top, 1.0):
        return False
    null = vectors[:, values <= 1e-12 * top] / s[:, None]
    return bool(
        np.abs(G @ null).max(initial=0.0)
        <= 1e-9
        * max(np.abs(G).max(initial=0.0), 1e-300)
        * max(np.abs(null).max(initial=0.0), 1e-300)
    )
