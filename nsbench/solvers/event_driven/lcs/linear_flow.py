"""Arcs of linear flows x' = G x + g(t) to rounding, with every sign change of linear functions on
the way.

Collocation at the 12 Radau points (Radau IIA of order 23, L-stable: Hairer & Wanner II, IV.5): one
linear system per step, whose matrix is kept for each step length. The polynomial of a step is its
dense output; a step counts if the last Chebyshev coefficients of state, inputs and functions are at
the tolerance, else it is halved. Then sign changes are roots of polynomials that are known to be
the functions.
"""

from __future__ import annotations

import numpy as np

STAGES = 12
FOLLOWED = (
    2000  # steps of another integrator from the first node to the last: what needs more is no step
)
EPS = np.finfo(float).eps


def _radau(s):
    """Nodes on [0, 1] with 0 in front and 1 at the end: zeros of P_s - P_(s-1), shifted."""
    c = np.zeros(s + 1)
    c[s] = 1.0
    c[s - 1] = -1.0
    x = np.sort(np.polynomial.legendre.legroots(c).real)
    for _ in range(3):  # Newton: the eigenvalues lose some digits
        x -= np.polynomial.legendre.legval(x, c) / np.polynomial.legendre.legval(
            x, np.polynomial.legendre.legder(c)
        )
    x[-1] = 1.0
    return np.concatenate(([-1.0], x))


def _inverse(A):
    """The inverse, its last digits corrected in long double: the rules below are used thousands of
    times."""
    X = np.linalg.inv(A).astype(np.longdouble)
    for _ in range(2):
        X += X @ (np.eye(len(A)) - A.astype(np.longdouble) @ X)
    return X


def _integrals(nodes):
    """(s, s) integrals from 0 to each node of the Lagrange polynomials of the nodes, for nodes on
    [-1, 1] and times on [0, 1]."""
    cheb = np.polynomial.chebyshev
    A = np.array(
        [cheb.chebval(nodes, cheb.chebint(e, lbnd=-1)) for e in np.eye(len(nodes))]
    ).T.astype(np.longdouble)
    return (0.5 * A @ _inverse(cheb.chebvander(nodes, len(nodes) - 1))).astype(float)


S = _radau(STAGES)  # on [-1, 1]
TO_CHEB = _inverse(np.polynomial.chebyshev.chebvander(S, STAGES)).astype(float)
BUTCHER = _integrals(S[1:])
SUM = _integrals(S)
FIT = _inverse(np.polynomial.chebyshev.chebvander(S[1:], STAGES - 1)).astype(
    float
)  # of the nodes that are collocated at
BACK = (
    np.polynomial.chebyshev.chebvander(S[:1], STAGES - 1)[0]
    @ _inverse(np.polynomial.chebyshev.chebvander(S[1:], STAGES - 1))
).astype(float)
FASTEST = 7.0  # growths of a state in one step, beyond which a step is not taken
# roundings in the last coefficients of a step, or in what is carried back to its first node: 13
# values
NOISE = 64.0


class LinearFlow:
    """The flow of one mode: steps with kept factors."""

    def __init__(self, mode, inputs, method: str = "dop853", tol: float = 1e-12):
        self.mode = mode
        self.inputs = inputs
        self._factors = {}
        self._method = method
        self._tol = tol
        self.scale = np.ones(len(mode.G))
        self.steps = 1  # of the integrator, in the last step
        rates = np.linalg.eigvals(mode.G)
        self.fastest, self.grows = (
            float(np.abs(rates).max(initial=0.0)),
            max(0.0, float(rates.real.max(initial=0.0))),
        )

    def step(self, t: float, x: np.ndarray, h: float):
        """Values at the nodes: x (13, n), inputs (13, order + 1, n + m). Methods other than the
        default integrate with `_arc.follow` from node to node: slower, and a check of the
        collocation."""
        return (self.collocate if self._method == "dop853" else self._followed)(t, x, h)

    def collocate(self, t, x, h):
        from scipy.linalg import lu_factor, lu_solve

        m = self.mode
        n = x.size
        s = np.array([self.inputs(t + 0.5 * h * (1.0 + c), m.order) for c in S])
        g = np.einsum("kij,akj->ai", m.U, s)
        if h not in self._factors:
            if len(self._factors) > 64:
                self._factors.clear()
            M = np.eye(STAGES * n) - np.kron(BUTCHER, h * m.G)
            self._factors[h] = M, lu_factor(M, check_finite=False)
        M, factors = self._factors[h]
        rhs = (
            h * BUTCHER @ (g[1:] + m.G @ x)
        ).ravel()  # for the change of x: rounding is relative to it
        d = lu_solve(factors, rhs, check_finite=False)
        d += lu_solve(
            factors, rhs - M @ d, check_finite=False
        )  # states of very different size are mixed in M
        return np.vstack([x, x + d.reshape(STAGES, n)]), s

    def missed(self, t, s, h, seen):
        """What collocation does not see of the inputs: (n,) of the state, (m,) of the functions, as
        far as it is told.

        Jumps right behind the first node of the step: it takes inputs from the other nodes alone,
        and what these are carried back to is held against those at the first. Pulses between the
        nodes: seen, times within the step with the inputs there (K,), (K, order + 1, n + m). What a
        stiff mode forgets within a step is none of it.
        """
        roundings = NOISE * EPS
        damped = self._damped
        if self._method != "dop853":
            return np.zeros(len(self.mode.G)), np.zeros(len(self.mode.signs))
        c = TO_CHEB @ s.reshape(len(s), -1)
        slope = np.polynomial.chebyshev.chebder(
            FIT @ s[1:].reshape(STAGES, -1)
        )  # without a jump behind the first node
        pace = np.abs(slope).sum(axis=0).reshape(s.shape[1:]) * 2.0 / h
        noise = roundings * (
            np.abs(s).max(axis=0) + (abs(t) + h) * pace
        )  # of the inputs, and of the time in them
        beyond = lambda off: np.where(off > noise, off, 0.0)
        behind = beyond(np.abs(s[0] - np.einsum("a,akj->kj", BACK, s[1:])))
        times, inputs = seen
        at = 2.0 * (times - t) / h - 1.0
        between = np.polynomial.chebyshev.chebval(at, c).T.reshape(inputs.shape) - inputs
        between = beyond(np.abs(between).max(axis=0)) if len(times) else np.zeros_like(behind)
        return (
            damped(0.5 * h * (S[1] - S[0]), np.einsum("kij,kj->i", np.abs(self.mode.U), behind))
            + damped(h, np.einsum("kij,kj->i", np.abs(self.mode.U), between)),
            np.einsum("ikl,kl->i", np.abs(self.mode.signs_s), between),
        )

    def _damped(self, h, speed):
        """(n,) what becomes of so much more speed for a time h: implicit Euler's change, and the
        growth of what grows."""
        if not speed.any():
            return np.zeros(len(speed))
        short = h / (
            1.0 + 2.0 * h * self.grows
        )  # half of where the step of a mode that grows has no solution
        return (
            np.exp(min(h * self.grows, FASTEST))
            * h
            * np.abs(np.linalg.inv(np.eye(len(speed)) - short * self.mode.G))
            @ speed
        )

    def _followed(self, t, x, h):
        from nsbench.solvers.event_driven.smooth.arc import integrate_to_event

        m = self.mode
        times = 0.5 * h * (1.0 + S)
        size = np.maximum(self.scale, np.abs(x))
        self.steps = 1
        G = m.G * size / size[:, None]  # tolerances are relative to each state, and
        stiff = max(
            1.0, h * float(np.abs(G).sum(axis=1).max())
        )  # what a mode forgets of an error, its multipliers keep
        rhs = lambda a, y: G @ y + np.einsum("kij,kj->i", m.U, self.inputs(t + a, m.order)) / size
        X = np.full((len(S), x.size), np.nan)
        s = np.array([self.inputs(t + a, m.order) for a in times])
        if np.all(np.isfinite(s)):
            arc = integrate_to_event(
                rhs,
                0.0,
                x / size,
                times[-1],
                method=self._method,
                rtol=0.1 * self._tol / stiff,
                samples=times[1:-1],
                max_steps=FOLLOWED,
            )
            X = size * np.vstack([x / size, arc.samples, arc.y]) if arc.status.ok else X
            self.steps = max(arc.steps, 1)
        return X, s

    def functions(self, X, s):
        """(13, m): lam on the rows of the mode, w elsewhere."""
        return X @ self.mode.signs.T + np.einsum("ikl,akl->ai", self.mode.signs_s, s)

    def at(self, t, x, scale):
        """(m,) the functions at one time, and the sizes of their terms; scale: sizes of the states
        (n,), inputs (n + m,)."""
        return self._linear(self.mode.signs, self.mode.signs_s, t, x, scale)

    def off(self, t, x, scale):
        """(c,) how far the state is from the constraints of the mode, and the sizes of their
        terms."""
        return self._linear(self.mode.held, self.mode.held_s, t, x, scale)

    def _linear(self, row, row_s, t, x, scale):
        s = self.inputs(t, self.mode.order)
        most = np.abs(s)
        most[0] = np.maximum(most[0], scale[1])
        size = np.abs(row) @ scale[0] + np.einsum("ikl,kl->i", np.abs(row_s), most)
        return row @ x + np.einsum("ikl,kl->i", row_s, s), size

    def project(self, t, x, weight):
        """x moved onto the constraints of the mode by the least change relative to weight (n,)."""
        if not len(self.mode.held):
            return x
        f, _ = self.off(t, x, (weight, 0.0))
        return x - weight * np.linalg.lstsq(self.mode.held * weight, f, rcond=None)[0]


def resolved(values: np.ndarray, limit: np.ndarray) -> tuple[bool, bool]:
    """(is the polynomial through values (13, k) the function up to limit (k,), would half the
    points do?)"""
    c = np.abs(TO_CHEB @ values)
    tail = c[-2:].max(axis=0, initial=0.0)
    half = c[STAGES // 2 :].max(axis=0, initial=0.0)
    return bool(np.all(tail <= limit)), bool(np.all(half <= limit))


def value(nodes: np.ndarray, s: float) -> np.ndarray:
    """The polynomial through the values `nodes` (13, k) at s in [-1, 1]."""
    return np.polynomial.chebyshev.chebval(s, TO_CHEB @ nodes)


def crossing(f: np.ndarray, level: np.ndarray):
    """(s, index) of the first downward crossing of one of the polynomials f (13, k) through its
    level, or None.

    A level below zero only keeps rounding from being a crossing: what falls through it has crossed
    at its zero before.
    """
    zero = TO_CHEB @ f
    c = zero - np.eye(STAGES + 1, 1) * level
    best = None
    for i in np.flatnonzero(c[0] - np.abs(c[1:]).sum(axis=0) <= 0.0):
        s = _first(c[:, i])
        if s is not None and (best is None or s < best[0]):
            best = s, int(i)
    if best is not None and level[best[1]] < 0.0:
        before = [r for r, _ in _falls(zero[:, best[1]]) if r <= best[0]]
        best = (before[-1] if before else best[0]), best[1]
    return best


def _first(c):
    """First point of [-1, 1] behind which the series is negative; None if there is none."""
    if np.polynomial.chebyshev.chebval(-1.0, c) < 0.0:
        return -1.0
    falls = _falls(c)
    if falls:
        return falls[0][0]
    return 1.0 if np.polynomial.chebyshev.chebval(1.0, c) < 0.0 else None


def _falls(c):
    """Zeros in [-1, 1] behind which the series is negative, with a point there."""
    top = np.abs(c).sum()
    k = len(c)
    while k > 2 and abs(c[k - 1]) <= EPS * top:
        k -= 1
    c = c[:k]
    roots = np.polynomial.chebyshev.chebroots(c)
    d = np.polynomial.chebyshev.chebder(c)
    real = roots.real[(np.abs(roots.imag) <= 1e-6) & (np.abs(roots.real) <= 1.0 + 1e-6)]
    for _ in range(2):  # Newton: a double root loses half of the digits, no more
        slope = np.polynomial.chebyshev.chebval(real, d)
        move = np.where(
            slope != 0.0,
            np.polynomial.chebyshev.chebval(real, c) / np.where(slope != 0.0, slope, 1.0),
            0.0,
        )
        real = np.where(np.abs(move) <= 1e-5, real - move, real)
    real = np.sort(np.clip(real, -1.0, 1.0))
    behind = 0.5 * (real + np.append(real[1:], 1.0))
    return [
        (float(r), float(m))
        for r, m in zip(real, behind, strict=True)
        if np.polynomial.chebyshev.chebval(m, c) < 0.0
    ]
