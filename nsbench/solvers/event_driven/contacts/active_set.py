"""Choose which of the closed contacts are active: the velocity LCP, with look-ahead.

With M = G G^T and h = G f + dg/dt of the closed contacts, the velocity x' = f + G^T lam follows
from

    0 <= lam  _|_  w = h + M lam >= 0,        w: rates of the gaps.

A contact with neither multiplier nor rate is undecided; so is every contact at the instant of its
release, and one that touches tangentially. The LCP is then solved a little later along the flow, at
times that grow until every decision is strict. Without that, releases chatter.

Coordinates that no closed contact and no operation of the drift couples move independently: the
LCP, its look-ahead too, separates into parts, and only those in which a contact closed, opened or
lost its multiplier are solved again.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nsbench.solvers.event_driven.contacts.evaluation import ContactField, ContactRows
from nsbench.solvers.event_driven.contacts.gram_matrix import Dense, Sparse, gram_of
from nsbench.solvers.event_driven.contacts.kernels.loop_state import AffineDrift

DEPENDENT = 1e-10  # squared sine of the angle between a gradient and the span of the active ones
UNDECIDED = 1e-7  # rates and multipliers, relative to the drift, up to which one looks ahead
STRICT = 1e-12  # relative to the drift: what is larger ahead is decided; a thousand roundings
# length of a gradient, relative to its length at the start, that counts as zero
ZERO_GRADIENT = 1e-8
LOOK_AHEAD = 10.0 ** np.arange(-5, 0)  # times ahead, in steps of the integrator
# Relative to the drift: a multiplier may start this negative if it is strictly positive ahead.
NEGATIVE_START = 1e-3
CHOSEN_TOGETHER = 300  # closed contacts: up to so many are solved faster than parts are found


@dataclass(frozen=True, eq=False)
class ActiveSet:
    """Choice among m closed contacts.

    active: indices of independent contacts, ascending. closed: mask of those that stay closed.
    stuck: index of a contact that no velocity satisfies, or -1. flat: its gradient vanishes or is
    not finite.
    """

    active: np.ndarray
    closed: np.ndarray
    stuck: int = -1
    flat: bool = False


class ActiveSetSelector:
    """Choose active sets; keep the size of the drift, relative to which rates are small.

    drift_size: largest |f_i| and |dg/dt| / |G| so far. solved, iterations: LCPs and their pivots.
    """

    def __init__(self, field: ContactField):
        self.field = field
        self.drift_size = 0.0
        self.solved = 0
        self.iterations = 0
        self._patterns: dict = {}

    def choose(
        self, t: float, x: np.ndarray, rows: ContactRows, warm: np.ndarray, step: float
    ) -> ActiveSet:
        """Choose the active among the closed contacts `rows` at x (n,).

        warm: indices of contacts that were active, from which the LCP starts. step: a step of the
        integrator, the time scale of the look-ahead.
        """
        m = len(rows)
        none = np.zeros(m, bool)
        self._update_drift_size(t, x, rows, step)
        (lam, w, support, code, bad), M, _ = self._solve_velocity(t, x, rows, warm)
        norm = M.norm
        flat = np.flatnonzero(~(norm >= ZERO_GRADIENT * rows.norm))
        if flat.size:
            return ActiveSet(support, none, int(flat[0]), True)
        if code == 1:  # perhaps by rounding alone: solve again with a tolerance
            (lam, w, support, code, bad), M, _ = self._solve_velocity(
                t, x, rows, warm, strictly=False
            )
        if code == 1:
            return ActiveSet(support, none, int(bad))
        small = UNDECIDED * self.drift_size
        shut = np.flatnonzero(w <= small * norm)
        strong = support[lam[support] * norm[support] > small]
        if len(strong) == len(shut):
            return ActiveSet(np.sort(strong), mask_of(m, strong))
        return self._look_ahead(t, x, rows, shut, support, step, lam * norm, M)

    def _update_drift_size(self, t, x, rows, step):
        """Update drift_size with the drift and the rates of the gaps here and a step later."""
        for s in (t, t + step):
            f = self.field.drift(s, x)
            rate = self.field.rates(s, x, rows) / rows.norm
            size = max(np.abs(f).max(initial=0.0), np.abs(rate).max(initial=0.0))
            if np.isfinite(size):
                self.drift_size = max(self.drift_size, size)

    def _solve_velocity(self, t, x, rows, warm, strictly=True):
        """Solve the velocity LCP: ((lam, w, support, code, stuck row), Gram matrix, x')."""
        from nsbench.solvers.event_driven.contacts.kernels.constraint_rows import add_transposed

        M, h, (C, V, count, v) = self._velocity_problem(t, x, rows)
        tol = 1e-14 * (np.abs(h).max(initial=0.0) + self.drift_size * M.norm) + (
            0.0 if strictly else 1e-12 * self.drift_size * M.norm
        )
        *solution, its = M.solve(h, np.asarray(warm, np.int64), tol, DEPENDENT, self.drift_size)
        self.solved += 1
        self.iterations += its
        add_transposed(C, V, count, solution[0], v)
        return solution, M, v

    def _velocity_problem(self, t, x, rows):
        """Return the Gram matrix, h = G f + dg/dt, and the gradients with f."""
        from nsbench.solvers.event_driven.contacts.kernels.constraint_rows import times

        C, V, count = self.field.gradients(t, x, rows)
        f = np.array(self.field.drift(t, x), float)
        return (
            gram_of(C, V, count, f.size, self._patterns),
            times(C, V, count, f) + self.field.rates(t, x, rows),
            (C, V, count, f),
        )

    def _look_ahead(self, t, x, rows, shut, support, step, strength, M: Dense | Sparse):
        """Solve the LCP of the contacts that stay shut at later times until all are decided."""
        part = self.field.take(rows, shut)
        position = {int(k): a for a, k in enumerate(shut)}
        warm = [position[int(k)] for k in support if int(k) in position]
        small = UNDECIDED * self.drift_size
        best = np.array([k for k in support if strength[k] > small], np.int64)
        for delta in step * LOOK_AHEAD:
            y = self._state_ahead(t, x, part, warm, delta)
            if y is None:
                continue
            (lam, w, active, code, _), M2, _ = self._solve_velocity(t + delta, y, part, warm)
            if code == 1 or not np.all(np.isfinite(lam)):
                continue
            norm = M2.norm
            active = active[lam[active] * norm[active] > STRICT * self.drift_size]
            if not self._is_admissible(t, x, part, active):
                continue
            best = shut[active]
            opening = w > STRICT * self.drift_size * norm
            if np.all(opening | M2.span(active, DEPENDENT)):
                break
        closed = mask_of(len(rows), shut) & M.span(best, DEPENDENT)
        return ActiveSet(np.sort(best), closed)

    def _is_admissible(self, t, x, part, active) -> bool:
        """Check that no multiplier of this set is negative now, beyond the look-ahead error."""
        if not active.size:
            return True
        rows = self.field.take(part, active)
        M, h, _ = self._velocity_problem(t, x, rows)
        return bool(np.all(M.hold(h) * rows.norm >= -NEGATIVE_START * self.drift_size))

    def _state_ahead(self, t, x, part, warm, delta):
        """Return the state after delta: one classical Runge-Kutta step, an LCP in every stage."""
        k = np.zeros_like(x)
        total = np.zeros_like(x)
        for c, weight in ((0.0, 1 / 6), (0.5, 1 / 3), (0.5, 1 / 3), (1.0, 1 / 6)):
            (lam, _, active, code, _), _, k = self._solve_velocity(
                t + c * delta, x + c * delta * k, part, warm
            )
            if code == 1 or not np.all(np.isfinite(lam)):
                return None
            warm = active
            total += weight * k
        return x + delta * total


def label_parts(drift: AffineDrift) -> np.ndarray:
    """Label the coordinates that the matrix of the drift couples: connected components, (n,)."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    n = len(drift.constant)
    graph = csr_array((np.ones(len(drift.cols)), drift.cols, drift.ptr), shape=(n, n))
    return connected_components(graph, directed=False)[1]


def affected_by_event(
    field: ContactField,
    t: float,
    x: np.ndarray,
    rows: ContactRows,
    labels: np.ndarray,
    closed: np.ndarray,
    changed: np.ndarray,
) -> np.ndarray:
    """Find the contacts in parts in which a contact changed; (m,) mask of `rows`.

    Parts are the connected components of the graph of coordinates, joined by the drift (labels) and
    by the contacts in the mask `closed`. changed (m,): mask.
    """
    k = np.flatnonzero(closed)
    if len(k) <= CHOSEN_TOGETHER:
        return np.ones(len(closed), bool)
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    C, _, count = field.gradients(t, x, field.take(rows, k))
    a, e = np.nonzero(np.arange(C.shape[1]) < count[:, None])
    size = int(labels.max()) + 1
    edges = coo_array(
        (np.ones(len(a)), (labels[C[a, e]], size + a)), shape=(size + len(k), size + len(k))
    )
    part = connected_components(edges, directed=False)[1][size:]
    out = np.zeros(len(closed), bool)
    out[k] = np.isin(part, part[changed[k]])
    return out


def mask_of(m: int, index: np.ndarray) -> np.ndarray:
    """Return the mask (m,) of some indices."""
    out = np.zeros(m, bool)
    out[index] = True
    return out
