"""Gaps, gradients and rates of fixed contacts at many states at once."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from nsbench.dynamics.contacts.candidates import ANCHOR, PAIR, ROW, SMOOTH, CandidateContacts
from nsbench.dynamics.contacts.constraint_set import ConstraintSet, near_of
from nsbench.error_bars.unit_gradients import UnitGradients, for_kernel

if TYPE_CHECKING:
    from nsbench.error_bars.kernels.case_rows import Listed
    from nsbench.error_bars.kernels.unit_gradients import Constraints

NO_GRADIENTS = np.empty((0, 0, 0))


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

    @property
    def m(self) -> int:
        """Number of contacts."""
        return len(self.ids)

    @property
    def is_moving(self) -> bool:
        """May constraints of the scene move?"""
        return self.scene.moving

    @cached_property
    def is_straight(self) -> bool:
        """Are all contacts affine rows?"""
        return bool(np.all(self.near.kind == ROW))

    @cached_property
    def _in_kernels(self) -> Constraints:
        from nsbench.error_bars.kernels.unit_gradients import Constraints

        scene = self.scene
        return Constraints(
            self.near.contacts, scene.ptr, scene.cols, scene.vals, scene.row_lengths
        )

    @cached_property
    def _columns(self) -> tuple[np.ndarray, np.ndarray]:
        """Columns (m, w) and counts (m,) of the entries of gradients."""
        return _columns(self.scene, self.near)

    def _moving_data(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return anchors (K, a) and constants of rows (K, rows) at the times t; once where they do
        not move."""
        if not self.is_moving:
            return self._still
        times = t.tolist()
        anchors = np.array([self.scene.anchors(s) for s in times])
        return anchors, np.array([self.scene.b(s) for s in times])

    @cached_property
    def _still(self) -> tuple[np.ndarray, np.ndarray]:
        return self.scene.anchors(0.0)[None], self.scene.b(0.0)[None]

    def _evaluate(self, t, X, states: int) -> tuple[np.ndarray, np.ndarray]:
        """Return gaps (K, m) and entries (states, m, w) of gradients, those of no or of all."""
        from nsbench.error_bars.kernels.unit_gradients import gaps_and_gradients

        g = np.empty((len(X), self.m))
        V = np.zeros((states, *self._columns[0].shape)) if states else NO_GRADIENTS
        X = for_kernel(X)
        gaps_and_gradients(self._in_kernels, *self._moving_data(t), X, g, V)
        every = np.arange(self.m)
        for k, (s, x) in enumerate(zip(t, X, strict=True)) if self.has_smooth else ():
            self.fill_smooth(float(s), x, every, g[k], V[k] if states else V)
        return g, V

    @cached_property
    def has_smooth(self) -> bool:
        """Is a contact one of a Smooth constraint, which kernels leave to their caller?"""
        return bool(np.any(self.near.kind == SMOOTH))

    def fill_smooth(
        self, t: float, x: np.ndarray, at: np.ndarray, g: np.ndarray, V: np.ndarray
    ) -> None:
        """Fill, for those of the contacts `at` (m,) that are Smooth ones, g (m,) with the gaps and
        V (m, w) with the gradients at x (n,), as kernels do for the others; V of length 0 asks for
        none."""
        near = self.near
        smooth = near.kind[at] == SMOOTH
        for s in sorted({*near.q[at][smooth].tolist()}):
            fam = self.scene.smooth(s)
            sel = np.flatnonzero(smooth & (near.q[at] == s))
            rows = fam.gradient(t, x)[near.p[at[sel]]]
            lengths = np.linalg.norm(rows, axis=1)
            g[sel] = fam.g(t, x)[near.p[at[sel]]] / lengths
            if len(V):
                V[sel, : len(x)] = rows / lengths[:, None]

    def gaps(self, t: np.ndarray, X: np.ndarray) -> np.ndarray:
        """Return (K, m) the gaps, each divided by the length of its gradient."""
        return self._evaluate(t, X, 0)[0]

    @cached_property
    def _constant(self) -> UnitGradients:
        _, V = self._evaluate(np.zeros(1), np.zeros((1, self.scene.n)), 1)
        return UnitGradients(*self._columns, V, self.scene.n)

    def gradients(self, t: np.ndarray, X: np.ndarray) -> UnitGradients:
        """Return the gradients at K states, scaled to length one."""
        return self._constant if self.is_straight else self.gaps_and_gradients(t, X)[1]

    def gaps_and_gradients(self, t: np.ndarray, X: np.ndarray) -> tuple[np.ndarray, UnitGradients]:
        """Return (K, m) the gaps and the gradients at K states, both scaled to gradients of length
        one."""
        if self.is_straight:
            return self.gaps(t, X), self._constant
        g, V = self._evaluate(t, X, len(X))
        return g, UnitGradients(*self._columns, V, X.shape[1])

    def constant_gradients(self, t: float, x: np.ndarray) -> np.ndarray:
        """Return (m, n) the gradients of flat faces, which are those at any state.

        Where both ends of a link on a line coincide at x (n,), it has the gradient of a state at
        which they do not: a link has two sides, and the sign tells which one is meant.
        """
        at = np.array([t])
        N = self.gradients(at, x[None]).dense()[0]
        lost = ~N.any(axis=1)
        if lost.any():
            apart = x + np.sqrt(np.arange(2.0, len(x) + 2.0))
            N[lost] = self.gradients(at, apart[None]).dense()[0][lost]
        return N

    def listed(self, centre: np.ndarray, reach: float, is_flat: bool) -> Listed:
        """Return the contacts as a list for kernels, of all pairs with a gap of at most `reach` at
        centre (n,); is_flat: of all constraints, which are flat."""
        from nsbench.error_bars.kernels.case_rows import Listed

        anchors, levels = (a[0].copy() for a in self._still)
        columns, count = self._columns
        of_list = centre, float(reach), bool(is_flat), bool(self.is_moving)
        return Listed(self._in_kernels, columns, count, anchors, levels, *of_list)

    @cached_property
    def as_list(self) -> Listed:
        """The contacts as a list for kernels."""
        return self.listed(np.zeros(self.scene.n), 0.0, True)

    def rates(self, t: np.ndarray, X: np.ndarray) -> np.ndarray:
        """Return (K, m) the partial derivatives of the gaps in time, by central differences."""
        from nsbench.error_bars.kernels.case_rows import TIME_STEP

        if not self.is_moving:
            return np.zeros((len(t), self.m))
        return (self.gaps(t + TIME_STEP, X) - self.gaps(t - TIME_STEP, X)) / (2.0 * TIME_STEP)

    def closed(self, t: np.ndarray, X: np.ndarray, rounds: int = 1) -> np.ndarray:
        """Return states (K, n) near X at which all contacts are closed: Gauss-Newton steps."""
        from nsbench.error_bars.kernels.local_piece import ROUNDING

        for _ in range(rounds if self.m else 0):
            g, N = self.gaps_and_gradients(t, X)
            step = N.normal_part(g, is_refined=rounds == 1)
            X = X - step
            if np.abs(step).max() ** 2 <= ROUNDING * np.abs(X).max():
                break  # they converge quadratically: the next step is one of rounding
        return X


def _columns(scene: ConstraintSet, near: CandidateContacts) -> tuple[np.ndarray, np.ndarray]:
    """Return columns (m, w) and counts (m,) of the entries of gradients."""
    is_distance = (near.kind == PAIR) | (near.kind == ANCHOR)
    count = np.where(near.kind == PAIR, 2 * near.dim, near.dim).astype(np.int64)
    count[near.kind == SMOOTH] = scene.n
    rows = np.flatnonzero(near.kind == ROW)
    count[rows] = scene.ptr[near.p[rows] + 1] - scene.ptr[near.p[rows]]
    columns = np.zeros((len(near), max(1, int(count.max(initial=1)))), np.int64)
    for dim in set(near.dim[is_distance].tolist()):
        of_dim = np.flatnonzero(is_distance & (near.dim == dim))
        columns[of_dim, :dim] = near.p[of_dim, None] + np.arange(dim)
        if (pairs := of_dim[near.kind[of_dim] == PAIR]).size:
            columns[pairs, dim : 2 * dim] = near.q[pairs, None] + np.arange(dim)
    for k in np.flatnonzero(near.kind == SMOOTH):
        columns[k, : scene.n] = np.arange(scene.n)
    for k in rows:
        columns[k, : count[k]] = scene.cols[scene.ptr[near.p[k]] : scene.ptr[near.p[k] + 1]]
    return columns, count


def size(v: np.ndarray) -> float:
    """Return the 2-norm of an array: of a short one, in a quarter of the time numpy takes."""
    flat = v.ravel()
    return math.sqrt(flat @ flat)
