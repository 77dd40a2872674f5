"""Integrate linear flows x' = G x + g(t) to rounding, with every sign change of linear functions.

Collocation at the 12 Radau points (Radau IIA of order 23, L-stable: Hairer & Wanner II, IV.5): one
linear system per step, whose factors are stored for each step length. The polynomial of a step is
its dense output; a step is accepted if the last Chebyshev coefficients of state, inputs and
functions are at the tolerance, else it is halved. Then sign changes are roots of polynomials that
equal the functions to the tolerance.
"""

from __future__ import annotations

import numpy as np

STAGES = 12
MAX_NODE_STEPS = 2000  # of another integrator in one step: where it needs more, the step is halved
EPS = np.finfo(float).eps


def _radau(s):
    """Return -1 and the s Radau nodes on [-1, 1], the last of them 1.

    The nodes are the zeros of P_s - P_(s-1).
    """
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
    """Invert A in long double precision.

    The last digits are corrected by Newton's iteration: the rules below are used thousands of
    times.
    """
    X = np.linalg.inv(A).astype(np.longdouble)
    for _ in range(2):
        X += X @ (np.eye(len(A)) - A.astype(np.longdouble) @ X)
    return X


def _integrals(nodes):
    """Return (s, s) integrals of the Lagrange polynomials of the nodes, from 0 to each node.

    For nodes on [-1, 1] and times on [0, 1].
    """
    cheb = np.polynomial.chebyshev
    A = np.array(
        [cheb.chebval(nodes, cheb.chebint(e, lbnd=-1)) for e in np.eye(len(nodes))]
    ).T.astype(np.longdouble)
    return (0.5 * A @ _inverse(cheb.chebvander(nodes, len(nodes) - 1))).astype(float)


NODES = _radau(STAGES)  # on [-1, 1]
TO_CHEB = _inverse(np.polynomial.chebyshev.chebvander(NODES, STAGES)).astype(float)
BUTCHER = _integrals(NODES[1:])
INTEGRALS = _integrals(NODES)
INTERPOLATE = _inverse(np.polynomial.chebyshev.chebvander(NODES[1:], STAGES - 1)).astype(
    float
)  # of the nodes that are collocated at
EXTRAPOLATE_BACK = (
    np.polynomial.chebyshev.chebvander(NODES[:1], STAGES - 1)[0]
    @ _inverse(np.polynomial.chebyshev.chebvander(NODES[1:], STAGES - 1))
).astype(float)
MAX_GROWTH_EXPONENT = 7.0  # growths of a state in one step, beyond which a step is not taken
# roundings in the last coefficients of a step, or in what is carried back to its first node: 13
# values
NOISE = 64.0


class LinearFlow:
    """Integrate the flow of one mode; store the factors of its collocation matrices."""

    def __init__(self, mode, inputs, method: str = "dop853", tol: float = 1e-12):
        self.mode = mode
        self.inputs = inputs
        self._factors = {}
        self._method = method
        self._tol = tol
        self.state_size = np.ones(len(mode.G))
        self.steps = 1  # of the integrator, in the last step
        rates = np.linalg.eigvals(mode.G)
        self.fastest_rate = float(np.abs(rates).max(initial=0.0))
        self.growth_rate = max(0.0, float(rates.real.max(initial=0.0)))

    def step(self, t: float, x: np.ndarray, h: float) -> tuple[np.ndarray, np.ndarray]:
        """Take one step; return the states (13, n) at the nodes and the inputs there.

        The inputs are (13, order + 1, n + m). Methods other than the default integrate with
        smooth.arc from node to node: slower, and a check of the collocation.
        """
        return (self.collocate if self._method == "dop853" else self._integrate_nodes)(t, x, h)

    def collocate(self, t: float, x: np.ndarray, h: float) -> tuple[np.ndarray, np.ndarray]:
        """Take one collocation step; return states (13, n) and inputs at the nodes."""
        from scipy.linalg import lu_factor, lu_solve

        m = self.mode
        n = x.size
        s = np.array([self.inputs(t + 0.5 * h * (1.0 + c), m.order) for c in NODES])
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

    def input_error(
        self, t: float, s: np.ndarray, h: float, seen: tuple
    ) -> tuple[np.ndarray, np.ndarray]:
        """Bound the effect of inputs that collocation misses, on state (n,) and functions (m,).

        Jumps right after the first node of the step: collocation takes inputs from the other nodes
        only, and their extrapolation is compared with the input at the first. Pulses between the
        nodes: `seen` has times (K,) within the step and inputs (K, order + 1, n + m) there. What a
        stiff mode damps within a step is not counted.
        """
        roundings = NOISE * EPS
        propagate = self._propagate
        if self._method != "dop853":
            return np.zeros(len(self.mode.G)), np.zeros(len(self.mode.signs))
        c = TO_CHEB @ s.reshape(len(s), -1)
        slope = np.polynomial.chebyshev.chebder(
            INTERPOLATE @ s[1:].reshape(STAGES, -1)
        )  # without a jump behind the first node
        pace = np.abs(slope).sum(axis=0).reshape(s.shape[1:]) * 2.0 / h
        noise = roundings * (
            np.abs(s).max(axis=0) + (abs(t) + h) * pace
        )  # of the inputs, and of the time in them
        beyond = lambda off: np.where(off > noise, off, 0.0)
        behind = beyond(np.abs(s[0] - np.einsum("a,akj->kj", EXTRAPOLATE_BACK, s[1:])))
        times, inputs = seen
        at = 2.0 * (times - t) / h - 1.0
        between = np.polynomial.chebyshev.chebval(at, c).T.reshape(inputs.shape) - inputs
        between = beyond(np.abs(between).max(axis=0)) if len(times) else np.zeros_like(behind)
        return (
            propagate(
                0.5 * h * (NODES[1] - NODES[0]), np.einsum("kij,kj->i", np.abs(self.mode.U), behind)
            )
            + propagate(h, np.einsum("kij,kj->i", np.abs(self.mode.U), between)),
            np.einsum("ikl,kl->i", np.abs(self.mode.signs_s), between),
        )

    def _propagate(self, h, speed):
        """Bound the change of the state (n,) by so much more speed for a time h.

        The change of an implicit Euler step, times the growth of unstable parts.
        """
        if not speed.any():
            return np.zeros(len(speed))
        short = h / (
            1.0 + 2.0 * h * self.growth_rate
        )  # half of where the step of a mode that grows has no solution
        return (
            np.exp(min(h * self.growth_rate, MAX_GROWTH_EXPONENT))
            * h
            * np.abs(np.linalg.inv(np.eye(len(speed)) - short * self.mode.G))
            @ speed
        )

    def _integrate_nodes(self, t, x, h):
        """Integrate from node to node with another integrator, as a check of the collocation."""
        from nsbench.solvers.event_driven.smooth.arc import integrate_to_event

        m = self.mode
        times = 0.5 * h * (1.0 + NODES)
        size = np.maximum(self.state_size, np.abs(x))
        self.steps = 1
        G = m.G * size / size[:, None]  # tolerances are relative to each state, and
        stiff = max(
            1.0, h * float(np.abs(G).sum(axis=1).max())
        )  # what a mode forgets of an error, its multipliers keep
        rhs = lambda a, y: G @ y + np.einsum("kij,kj->i", m.U, self.inputs(t + a, m.order)) / size
        X = np.full((len(NODES), x.size), np.nan)
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
                max_steps=MAX_NODE_STEPS,
            )
            X = size * np.vstack([x / size, arc.samples, arc.y]) if arc.status.ok else X
            self.steps = max(arc.steps, 1)
        return X, s

    def sign_functions(self, X: np.ndarray, s: np.ndarray) -> np.ndarray:
        """Return lam on the rows of the mode and w elsewhere at the nodes, (13, m)."""
        return X @ self.mode.signs.T + np.einsum("ikl,akl->ai", self.mode.signs_s, s)

    def sign_functions_at(
        self, t: float, x: np.ndarray, scale: tuple
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the sign functions (m,) at one time and the sizes of their terms.

        scale: sizes of the states (n,) and of the inputs (n + m,).
        """
        return self._linear(self.mode.signs, self.mode.signs_s, t, x, scale)

    def constraint_residual(
        self, t: float, x: np.ndarray, scale: tuple
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the residuals (c,) of the constraints of the mode and the sizes of their terms."""
        return self._linear(self.mode.constraint, self.mode.constraint_s, t, x, scale)

    def _linear(self, row, row_s, t, x, scale):
        """Evaluate row x + row_s s at one time; return the values and the sizes of their terms."""
        s = self.inputs(t, self.mode.order)
        most = np.abs(s)
        most[0] = np.maximum(most[0], scale[1])
        size = np.abs(row) @ scale[0] + np.einsum("ikl,kl->i", np.abs(row_s), most)
        return row @ x + np.einsum("ikl,kl->i", row_s, s), size

    def project(self, t: float, x: np.ndarray, weight: np.ndarray) -> np.ndarray:
        """Project x onto the constraints of the mode, least in the norm of x / weight (n,)."""
        if not len(self.mode.constraint):
            return x
        f, _ = self.constraint_residual(t, x, (weight, 0.0))
        return x - weight * np.linalg.lstsq(self.mode.constraint * weight, f, rcond=None)[0]


def is_resolved(values: np.ndarray, limit: np.ndarray) -> tuple[bool, bool]:
    """Check the polynomial through values (13, k) against limit (k,).

    Returns (its last coefficients are below the limit, half of the nodes would be enough).
    """
    c = np.abs(TO_CHEB @ values)
    tail = c[-2:].max(axis=0, initial=0.0)
    half = c[STAGES // 2 :].max(axis=0, initial=0.0)
    return bool(np.all(tail <= limit)), bool(np.all(half <= limit))


def evaluate(nodes: np.ndarray, s: float) -> np.ndarray:
    """Evaluate the polynomial through the values `nodes` (13, k) at s in [-1, 1]."""
    return np.polynomial.chebyshev.chebval(s, TO_CHEB @ nodes)


def first_crossing(f: np.ndarray, level: np.ndarray) -> tuple[float, int] | None:
    """Find the first downward crossing of one of the polynomials f (13, k) through its level.

    Returns (s, index), or None.

    A level below zero only keeps rounding from being a crossing: what falls through it has crossed
    at its zero before.
    """
    zero = TO_CHEB @ f
    c = zero - np.eye(STAGES + 1, 1) * level
    best = None
    for i in np.flatnonzero(c[0] - np.abs(c[1:]).sum(axis=0) <= 0.0):
        s = _first_fall(c[:, i])
        if s is not None and (best is None or s < best[0]):
            best = s, int(i)
    if best is not None and level[best[1]] < 0.0:
        before = [r for r, _ in _falls(zero[:, best[1]]) if r <= best[0]]
        best = (before[-1] if before else best[0]), best[1]
    return best


def _first_fall(c):
    """Return the first point of [-1, 1] after which the series is negative, or None."""
    if np.polynomial.chebyshev.chebval(-1.0, c) < 0.0:
        return -1.0
    falls = _falls(c)
    if falls:
        return falls[0][0]
    return 1.0 if np.polynomial.chebyshev.chebval(1.0, c) < 0.0 else None


def _falls(c):
    """List the zeros in [-1, 1] after which the series is negative, each with a point there."""
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
