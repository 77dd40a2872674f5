"""Gaps, gradients and rates of fixed contacts at many states at once."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from nsbench.dynamics.contacts.candidates import PAIR, CandidateContacts
from nsbench.dynamics.contacts.constraint_set import ConstraintSet, near_of

# Relative to the diagonal of the Gram matrix of unit normals: contacts that are dependent up to
# this are closed as one, not each for itself.
DAMPING = 1e-10
LARGE = 16  # rows from which Gram matrices are factored by the compiled kernel
PIVOTS = 8  # rounds of block pivoting
ROUNDING = 1e-14  # of the state: steps that end an iteration
TIME_STEP = 2.0**-20  # of own time, for the rate at which a moving constraint moves


class ContactRows:
    """The m contacts `ids` of a scene at K states: times t (K,), states X (K, n).

    near: the same contacts as candidates, where they are known.
    Gradients are scaled to length one with their gaps, so that a gap is a distance to first order.
    """

    def __init__(
        self, scene: ConstraintSet, ids: Sequence[tuple], near: CandidateContacts | None = None
    ):
        self.scene = scene
        self.ids = tuple(ids)
        self.near = near_of(scene, ids) if near is None else near
        self.layout = scene.layout(self.near)
        self.m = len(self.ids)
        rows = self.layout.rows
        self._rows = np.zeros((len(rows), scene.n))
        for e, p in enumerate(self.near.p[rows]):
            at = slice(scene.ptr[p], scene.ptr[p + 1])
            np.add.at(self._rows[e], scene.cols[at], scene.vals[at])
        self._sizes = np.linalg.norm(self._rows, axis=1)
        self._unit_rows = self._rows / self._sizes[:, None]
        self.is_straight = len(rows) == self.m
        self.is_moving = scene.moving
        smooth = enumerate(self.layout.smooth)
        self._families = [(scene.smooth(s), sel) for s, sel in smooth if sel.size]

    def gaps(self, t: np.ndarray, X: np.ndarray) -> np.ndarray:
        """Return (K, m) the gaps, each divided by the length of its gradient."""
        g = np.empty((len(t), self.m))
        for sel, _, diff in self._differences(t, X):
            dist = np.sqrt((diff * diff).sum(-1))
            lengths = np.sqrt(2.0) if self.near.kind[sel[0]] == PAIR else 1.0
            g[:, sel] = self.near.sign[sel] * (dist - self.near.d[sel]) / lengths
        rows = self.layout.rows
        if rows.size:
            b = np.array([self.scene.b(float(s))[self.near.p[rows]] for s in self._times(t)])
            g[:, rows] = (X @ self._rows.T + b) / self._sizes
        for fam, sel in self._families:
            for k, (s, x) in enumerate(zip(t, X, strict=True)):
                size = np.linalg.norm(fam.gradient(float(s), x)[self.near.p[sel]], axis=1)
                g[k, sel] = fam.g(float(s), x)[self.near.p[sel]] / size
        return g

    def _times(self, t):
        """Times at which b is evaluated: one of them where it does not move."""
        return t if self.is_moving else t[:1]

    def _differences(self, t, X):
        """Yield by kind and dimension: entries, coordinates of both ends, differences."""
        for kind, sel, i, j in self.layout.pairs:
            if kind == PAIR:
                yield sel, (i, j), X[:, i] - X[:, j]
            else:
                ends = np.array([self.scene.anchors(float(s))[j] for s in self._times(t)])
                yield sel, (i, None), X[:, i] - ends

    def gradients(self, t: np.ndarray, X: np.ndarray) -> np.ndarray:
        """Return (K, m, n) the gradients, scaled to length one."""
        if self.is_straight:
            return np.broadcast_to(self._unit_rows, (len(t), *self._unit_rows.shape))
        N = np.zeros((len(t), self.m, X.shape[1]))
        for sel, (i, j), diff in self._differences(t, X):
            dist = np.sqrt((diff * diff).sum(-1, keepdims=True))
            unit = np.divide(diff, dist, out=np.zeros_like(diff), where=dist > 0.0)
            unit *= self.near.sign[sel, None]
            if j is not None:
                unit /= np.sqrt(2.0)
                N[:, sel[:, None], j] = -unit
            N[:, sel[:, None], i] = unit
        if self.layout.rows.size:
            N[:, self.layout.rows] = self._unit_rows
        for fam, sel in self._families:
            for k, (s, x) in enumerate(zip(t, X, strict=True)):
                rows = fam.gradient(float(s), x)[self.near.p[sel]]
                N[k, sel] = rows / np.linalg.norm(rows, axis=1, keepdims=True)
        return N

    def constant_gradients(self, t: float, x: np.ndarray) -> np.ndarray:
        """Return (m, n) the gradients of flat faces, which are those at any state.

        Where both ends of a link on a line coincide at x (n,), it has the gradient of a state at
        which they do not: a link has two sides, and the sign tells which one is meant.
        """
        at = np.array([t])
        N = self.gradients(at, x[None])[0]
        lost = ~N.any(axis=1)
        if lost.any():
            apart = x + np.sqrt(np.arange(2.0, len(x) + 2.0))
            N[lost] = self.gradients(at, apart[None])[0][lost]
        return N

    def rates(self, t: np.ndarray, X: np.ndarray) -> np.ndarray:
        """Return (K, m) the partial derivatives of the gaps in time, by central differences."""
        if not self.is_moving:
            return np.zeros((len(t), self.m))
        return (self.gaps(t + TIME_STEP, X) - self.gaps(t - TIME_STEP, X)) / (2.0 * TIME_STEP)

    def closed(self, t: np.ndarray, X: np.ndarray, rounds: int = 1) -> np.ndarray:
        """Return states (K, n) near X at which all contacts are closed: Gauss-Newton steps."""
        for _ in range(rounds if self.m else 0):
            step = normal_part(self.gradients(t, X), self.gaps(t, X), is_refined=rounds == 1)
            X = X - step
            if np.abs(step).max() <= ROUNDING * np.abs(X).max():
                break
        return X


def size(v: np.ndarray) -> float:
    """Return the 2-norm of an array: of a short one, in a quarter of the time numpy takes."""
    flat = v.ravel()
    return math.sqrt(flat @ flat)


def times(N: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Return (K, m) the products N d of N (K, m, n) and d (K, n)."""
    return (N @ d[..., None])[..., 0]


def normal_part(N: np.ndarray, g: np.ndarray, is_refined: bool = True) -> np.ndarray:
    """Return (K, n) the shortest d with N d = g, for N (K, m, n) and g (K, m).

    Rows that depend on one another are damped by DAMPING; one step of iterative refinement, which
    an iteration over N does without.
    """
    if not g.any():
        return np.zeros((len(g), N.shape[2]))
    return _back(N, multipliers(N, g, is_refined))


def multipliers(N: np.ndarray, g: np.ndarray, is_refined: bool = False) -> np.ndarray:
    """Return (K, m) q with N N^T q = g, for N (K, m, n) with damped Gram matrices and g (K, m).

    is_refined: with a step of iterative refinement against the matrices without damping.
    """
    K, m, _ = N.shape
    if m >= LARGE and K:
        from nsbench.error_bars.kernels.gram import gram_multipliers

        q = np.empty((K, m))
        # numba compiles a function anew for arrays that may not be written to
        whole = [np.require(a, float, ["C", "W"]) for a in (N, g)]
        if gram_multipliers(*whole, DAMPING, is_refined, q):
            return q
    solve = _gram_solver(N)
    q = solve(g)
    if is_refined:
        q = q + solve(g - times(N, _back(N, q)))
    return q


def _gram_solver(N: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """Return the function that solves the damped Gram systems of N (K, m, n) for (K, m)."""
    m = N.shape[1]
    if m == 1:
        diagonal = (N * N).sum(axis=2) + DAMPING
        return lambda g: g / diagonal
    stack = N @ N.transpose(0, 2, 1) + DAMPING * np.eye(m)
    return lambda g: np.linalg.solve(stack, g[..., None])[..., 0]


def _back(N, q):
    return (q[:, None] @ N)[:, 0]


def off_cone(N: np.ndarray, d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Split d (K, n) into N^T q with q >= 0 and a shortest rest; return rest (K, n), q (K, m).

    The rest is what an inclusion x' in f + N^T q lacks. Where the unconstrained q is positive it is
    taken, else that of block pivoting, else nonnegative least squares.
    """
    q = multipliers(N, times(N, d))
    for k in np.flatnonzero((q < 0.0).any(axis=1)):
        found = _by_pivoting(N[k], d[k], q[k] > 0.0)
        if found is None:
            from scipy.optimize import nnls

            found = nnls(N[k].T, d[k])[0]
        q[k] = found
    return d - _back(N, q), q


def _by_pivoting(N: np.ndarray, d: np.ndarray, pushes: np.ndarray) -> np.ndarray | None:
    """Return q (m,) >= 0 for which d - N^T q is shortest, N (m, n), d (n,); None without success.

    pushes (m,): a guess of the rows with q > 0. All rows on the wrong side change sides at once
    (block pivoting: Portugal, Judice & Vicente, Math. Comp. 63, 1994), which can cycle.
    """
    for _ in range(PIVOTS):
        some = N[None, pushes]
        q = np.zeros(len(N))
        if pushes.any():
            q[pushes] = multipliers(some, times(some, d[None]), is_refined=True)[0]
        opens = N @ (d - q @ N) > 10.0 * DAMPING * size(d)
        wrong = (q < 0.0) | (opens & ~pushes)
        if not wrong.any():
            return q
        pushes = pushes ^ wrong
    return None


def least_change(N: np.ndarray, c: np.ndarray, f: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return v (n,) nearest to f (n,) with N v >= c, and q (m,) >= 0 with v = f + N^T q.

    A least-distance problem, solved as nonnegative least squares (Lawson & Hanson, Solving Least
    Squares Problems, 1974, chapter 23).
    """
    from scipy.optimize import nnls

    need = c - N @ f
    target = np.append(np.zeros(len(f)), 1.0)
    u, _ = nnls(np.vstack([N.T, need]), target)
    q = u / max(1.0 - float(need @ u), 1e-300)
    return f + N.T @ q, q
