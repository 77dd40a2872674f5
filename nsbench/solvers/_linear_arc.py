"""Arcs of linear flows x' = G x + g(t) to rounding, with every sign change of linear functions on the way.

Collocation at the 12 Radau points (Radau IIA of order 23, L-stable: Hairer & Wanner II, IV.5): one linear system per
step, whose matrix is kept for each step length. The polynomial of a step is its dense output; a step counts if the last
Chebyshev coefficients of state, inputs and functions are at the tolerance, else it is halved. Then sign changes are
roots of polynomials that are known to be the functions.
"""
from __future__ import annotations

import numpy as np

STAGES = 12
EPS = np.finfo(float).eps


def _radau(s):
    """Nodes on [0, 1] with 0 in front and 1 at the end: zeros of P_s - P_(s-1), shifted."""
    c = np.zeros(s + 1)
    c[s], c[s - 1] = 1.0, -1.0
    x = np.sort(np.polynomial.legendre.legroots(c).real)
    for _ in range(3):                                      # Newton: the eigenvalues lose some digits
        x -= np.polynomial.legendre.legval(x, c) / np.polynomial.legendre.legval(x, np.polynomial.legendre.legder(c))
    x[-1] = 1.0
    return np.concatenate(([-1.0], x))


def _inverse(A):
    """The inverse, its last digits corrected in long double: the rules below are used thousands of times."""
    X = np.linalg.inv(A).astype(np.longdouble)
    for _ in range(2):
        X += X @ (np.eye(len(A)) - A.astype(np.longdouble) @ X)
    return X


def _integrals(nodes):
    """(s, s) integrals from 0 to each node of the Lagrange polynomials of the nodes, for nodes on [-1, 1] and times on
    [0, 1]."""
    cheb = np.polynomial.chebyshev
    A = np.array([cheb.chebval(nodes, cheb.chebint(e, lbnd=-1)) for e in np.eye(len(nodes))]).T.astype(np.longdouble)
    return (0.5 * A @ _inverse(cheb.chebvander(nodes, len(nodes) - 1))).astype(float)


S = _radau(STAGES)                                          # on [-1, 1]
TO_CHEB = _inverse(np.polynomial.chebyshev.chebvander(S, STAGES)).astype(float)
BUTCHER, SUM = _integrals(S[1:]), _integrals(S)


class Flow:
    """The flow of one mode: steps with kept factors."""

    def __init__(self, mode, inputs, method: str = "dop853", tol: float = 1e-12):
        self.mode, self.inputs, self._factors = mode, inputs, {}
        self._method, self._tol = method, tol

    def step(self, t: float, x: np.ndarray, h: float):
        """Values at the nodes: x (13, n), inputs (13, order + 1, n + m). Methods other than the default integrate with
        `_arc.follow` from node to node: slower, and a check of the collocation."""
        if self._method != "dop853":
            return self._followed(t, x, h)
        from scipy.linalg import lu_factor, lu_solve
        m, n = self.mode, x.size
        s = np.array([self.inputs(t + 0.5 * h * (1.0 + c), m.order) for c in S])
        g = np.einsum("kij,akj->ai", m.U, s)
        if h not in self._factors:
            if len(self._factors) > 64:
                self._factors.clear()
            M = np.eye(STAGES * n) - np.kron(BUTCHER, h * m.G)
            self._factors[h] = M, lu_factor(M)
        M, factors = self._factors[h]
        rhs = (h * BUTCHER @ (g[1:] + m.G @ x)).ravel()      # for the change of x: rounding is relative to it
        d = lu_solve(factors, rhs)
        d += lu_solve(factors, rhs - M @ d)                 # states of very different size are mixed in M
        return np.vstack([x, x + d.reshape(STAGES, n)]), s

    def _followed(self, t, x, h):
        from nsbench.solvers._arc import follow
        m, times = self.mode, t + 0.5 * h * (1.0 + S)
        scale = np.abs(x).max() + h * np.abs(m.G @ x).max() or 1.0      # the tolerance is relative to the state
        rhs = lambda a, y: m.G @ y + np.einsum("kij,kj->i", m.U, self.inputs(a, m.order)) / scale
        arc = follow(rhs, t, x / scale, times[-1], method=self._method, rtol=0.1 * self._tol, samples=times[1:-1])
        X = np.full((len(S), x.size), np.nan)
        if arc.status.ok:
            X = scale * np.vstack([x / scale, arc.samples, arc.y])
        return X, np.array([self.inputs(a, m.order) for a in times])

    def functions(self, X, s):
        """(13, m): lam on the rows of the mode, w elsewhere."""
        return X @ self.mode.signs.T + np.einsum("ikl,akl->ai", self.mode.signs_s, s)

    def at(self, t, x, scale):
        """(m,) the functions at one time, and the sizes of their terms for states of the size `scale` (n,)."""
        s = self.inputs(t, self.mode.order)
        f = self.mode.signs @ x + np.einsum("ikl,kl->i", self.mode.signs_s, s)
        size = np.abs(self.mode.signs) @ scale + np.einsum("ikl,kl->i", np.abs(self.mode.signs_s), np.abs(s))
        return f, size

    def off(self, t, x, scale):
        """(c,) how far the state is from the constraints of the mode, and the sizes of their terms."""
        s = self.inputs(t, self.mode.order)
        f = self.mode.held @ x + np.einsum("ikl,kl->i", self.mode.held_s, s)
        return f, np.abs(self.mode.held) @ scale + np.einsum("ikl,kl->i", np.abs(self.mode.held_s), np.abs(s))

    def project(self, t, x, weight):
        """x moved onto the constraints of the mode by the least change relative to weight (n,)."""
        if not len(self.mode.held):
            return x
        f, _ = self.off(t, x, weight)
        return x - weight * np.linalg.lstsq(self.mode.held * weight, f, rcond=None)[0]


def resolved(values: np.ndarray, scale: np.ndarray, tol: float) -> tuple[bool, bool]:
    """(is the polynomial through values (13, k) the function to tol x scale, would half the points do?)"""
    c = np.abs(TO_CHEB @ values)
    floor = 8.0 * EPS * np.abs(values).max(axis=0, initial=0.0)
    tail, half = c[-2:].max(axis=0, initial=0.0), c[STAGES // 2:].max(axis=0, initial=0.0)
    return bool(np.all(tail <= tol * scale + floor)), bool(np.all(half <= tol * scale + floor))


def value(nodes: np.ndarray, s: float) -> np.ndarray:
    """The polynomial through the values `nodes` (13, k) at s in [-1, 1]."""
    return np.polynomial.chebyshev.chebval(s, TO_CHEB @ nodes)


def crossing(f: np.ndarray, level: np.ndarray):
    """(s, index) of the first downward crossing of one of the polynomials f (13, k) through its level, or None."""
    c = TO_CHEB @ f
    c[0] -= level
    best = None
    for i in np.flatnonzero(c[0] - np.abs(c[1:]).sum(axis=0) <= 0.0):
        s = _first(c[:, i])
        if s is not None and (best is None or s < best[0]):
            best = s, int(i)
    return best


def _first(c):
    """First point of [-1, 1] behind which the series is negative; None if there is none."""
    if np.polynomial.chebyshev.chebval(-1.0, c) <= 0.0:
        return -1.0
    top = np.abs(c).sum()
    k = len(c)
    while k > 2 and abs(c[k - 1]) <= EPS * top:
        k -= 1
    c = c[:k]
    roots = np.polynomial.chebyshev.chebroots(c)
    d = np.polynomial.chebyshev.chebder(c)
    real = roots.real[(np.abs(roots.imag) <= 1e-6) & (np.abs(roots.real) <= 1.0 + 1e-6)]
    for _ in range(2):
        slope = np.polynomial.chebyshev.chebval(real, d)
        move = np.where(slope != 0.0, np.polynomial.chebyshev.chebval(real, c) / np.where(slope != 0.0, slope, 1.0), 0.0)
        real = np.where(np.abs(move) <= 1e-5, real - move, real)
    real = np.sort(np.clip(real, -1.0, 1.0))
    behind = 0.5 * (real + np.append(real[1:], 1.0))
    for r, m in zip(real, behind, strict=True):
        if np.polynomial.chebyshev.chebval(m, c) < 0.0:
            return float(r)
    return 1.0 if np.polynomial.chebyshev.chebval(1.0, c) < 0.0 else None
