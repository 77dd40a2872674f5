"""Drift, gaps, gradients and multipliers of a Complementarity case, for lists of its
constraints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nsbench.case import Case
from nsbench.dynamics.contacts.constraint_set import (
    PAIR,
    ROW,
    SMOOTH,
    CandidateContacts,
    ConstraintSet,
)
from nsbench.dynamics.length_scale import case_length_scale
from nsbench.problem import Affine, Distance, Smooth
from nsbench.solvers.event_driven.interval_taylor import SPACE

# so many pairs of hard particles are all listed, without a certificate on the distance travelled
LISTED = 2000


@dataclass(frozen=True, eq=False)
class Rows:
    """A list of constraints made ready for the kernels: its arrays, the smooth ones, the longest
    row."""

    near: CandidateContacts
    slot: np.ndarray
    smooth: CandidateContacts | None
    width: int
    norm: np.ndarray  # (m,) lengths of the gradients; of smooth constraints that at the start

    def __len__(self) -> int:
        return len(self.near)


class ContactField:
    """Evaluations at (t, x) of the constraints of a case; counts drift calls."""

    def __init__(self, case: Case, scene: ConstraintSet):
        from nsbench.compilation.factories import as_numpy

        self.scene, self.n, self.calls, self.unit = scene, case.n, 0, case_length_scale(case)
        self._drift = as_numpy(case.problem.drift)
        families = scene.families
        self._boxes = [
            case.problem.drift,
            *[
                q
                for c in families
                if isinstance(c, Smooth)
                for q in (c.g, c.gradient, c.rate)
                if q is not None
            ],
        ]
        self._clocks = [
            c.b if isinstance(c, Affine) else c.anchors
            for c in families
            if isinstance(c, (Affine, Distance)) and c.moving
        ]
        self._moving_b = any(isinstance(c, Affine) and c.moving for c in families)
        self._moving_anchors = any(isinstance(c, Distance) and c.moving for c in families)
        t0 = float(case.t[0])
        self._b0, self._anchors0 = scene.b(t0), scene.anchors(t0)
        pairs = sum(m * (m - 1) // 2 for _, _, m in scene.hard)
        self.certified = pairs > LISTED
        self.reach = (
            min((2 * r.min() for r in scene.radii.values()), default=0.0)
            if self.certified
            else np.inf
        )
        self._smooth_norm = self._typical(t0, case.x0)
        self._hard = [c.start + np.arange(m * c.dim).reshape(m, c.dim) for _, c, m in scene.hard]

    def compile(self, t: float, x: np.ndarray, arcs: bool = True):
        """Load or compile every kernel once, on an empty list. arcs: those for arcs followed in
        Python too."""
        from nsbench.lcp.gram_lcp import in_span, solve_lcp
        from nsbench.solvers.event_driven.contacts.kernels.constraint_rows import (
            add_transposed,
            gram,
            gram_solve,
            held,
            times,
        )

        none = self.take(self.candidates(t, x), np.empty(0, np.int64))
        self.gaps(t, x, none)
        C, V, count = self.gradients(t, x, none)
        M = gram(C, V, count, self.n)
        index = np.empty(0, np.int64)
        v = np.empty(0)
        solve_lcp(M, v, index, v, 0.0)
        in_span(M, index, 0.0)
        add_transposed(C, V, count, times(C, V, count, x), x.copy())
        gram_solve(M, v)
        if arcs:
            held(C, V, count, x, v)

    def drift(self, t: float, x: np.ndarray) -> np.ndarray:
        self.calls += 1
        return self._drift(t, x)

    def data(self, t, x) -> list:
        """What the case gives as functions of (t, x), for Jets: drift, smooth constraints, moving
        walls and anchors."""
        return [q(SPACE)(t, x) for q in self._boxes] + [q(SPACE)(t) for q in self._clocks]

    def candidates(self, t: float, x: np.ndarray) -> Rows:
        """Every constraint that can become active before a particle has travelled reach / 2."""
        return self.rows(self.scene.near(np.ascontiguousarray(x), self.reach, t))

    def rows(self, near: CandidateContacts) -> Rows:
        smooth = near.kind == SMOOTH
        of_row = near.p[near.kind == ROW]
        width = max(
            1,
            int(2 * near.dim[near.kind > ROW].max(initial=0)),
            int(np.diff(self.scene.ptr)[of_row].max(initial=0)),
            self.n if smooth.any() else 0,
        )
        norm = np.where(near.kind == PAIR, np.sqrt(2.0), 1.0)
        norm[near.kind == ROW] = 1.0 / np.sqrt(self.scene.inv2[of_row])
        for k in np.flatnonzero(smooth):
            norm[k] = self._smooth_norm[(int(near.family[k]), int(near.i[k]))]
        return Rows(
            near, np.cumsum(smooth) - 1, near.take(smooth) if smooth.any() else None, width, norm
        )

    def _typical(self, t, x):
        """Length of the gradient of every smooth constraint at the start: what makes its values
        large or small."""
        listed = self.scene.all_static()
        smooth = listed.take(listed.kind == SMOOTH)
        norm = np.linalg.norm(self.scene.dense_gradients(t, x, smooth), axis=1)
        norm[~(norm > 0.0) | np.isinf(norm)] = 1.0
        return dict(zip(smooth.ids, norm.tolist(), strict=True))

    def take(self, rows: Rows, index) -> Rows:
        near = rows.near.take(index)
        return (
            self.rows(near)
            if rows.smooth is not None
            else Rows(near, rows.slot[index], None, rows.width, rows.norm[index])
        )

    def _places(self, t):
        return (
            self.scene.anchors(t) if self._moving_anchors else self._anchors0,
            self.scene.ptr,
            self.scene.cols,
            self.scene.vals,
        )

    def gaps(self, t: float, x: np.ndarray, rows: Rows) -> np.ndarray:
        """(m,) values g_k."""
        from nsbench.solvers.event_driven.contacts.kernels.constraint_rows import fill_gaps

        k = rows.near
        g = np.empty(len(rows))
        b = self.scene.b(t) if self._moving_b else self._b0
        fill_gaps(
            k.kind, k.p, k.q, k.d, k.sign, k.dim, np.ascontiguousarray(x), *self._places(t), b, g
        )
        if rows.smooth is not None:
            g[k.kind == SMOOTH] = self.scene.gaps(t, x, rows.smooth)
        return g

    def gradients(self, t: float, x: np.ndarray, rows: Rows):
        """Columns, values (m, width) and lengths (m,) of the gradients."""
        from nsbench.solvers.event_driven.contacts.kernels.constraint_rows import fill_rows

        k = rows.near
        dense = (
            np.zeros((0, self.n))
            if rows.smooth is None
            else self.scene.dense_gradients(t, x, rows.smooth)
        )
        return fill_rows(
            k.kind,
            k.p,
            k.q,
            k.sign,
            k.dim,
            rows.slot,
            np.ascontiguousarray(x),
            *self._places(t),
            dense,
            rows.width,
        )

    def rates(self, t: float, x: np.ndarray, rows: Rows) -> np.ndarray:
        return self.scene.rates(t, x, rows.near) if self.scene.moving else np.zeros(len(rows))

    def held(self, t: float, x: np.ndarray, rows: Rows):
        """x', multipliers and reaction with all of `rows` (independent) held at zero."""
        from nsbench.solvers.event_driven.contacts.kernels.constraint_rows import held

        f = self.drift(t, x)
        if not len(rows):
            return f, np.empty(0), np.zeros(self.n)
        return held(*self.gradients(t, x, rows), np.ascontiguousarray(f), self.rates(t, x, rows))

    def project(self, t: float, x: np.ndarray, rows: Rows) -> np.ndarray | None:
        """The point with all of `rows` at zero, along their gradients; None if x is it, up to
        rounding."""
        from nsbench.solvers.event_driven.contacts.kernels.constraint_rows import (
            add_transposed,
            gram,
            gram_solve,
        )

        if not len(rows):
            return None
        y = x
        fine = 2e-15 * (self.unit + np.abs(x).max()) * rows.norm
        for _ in range(3):
            g = self.gaps(t, y, rows)
            if np.all(np.abs(g) <= fine):
                break
            C, V, count = self.gradients(t, y, rows)
            y = y.copy()
            add_transposed(C, V, count, gram_solve(gram(C, V, count, self.n), -g), y)
        return None if y is x or not np.all(np.isfinite(y)) else y

    def travelled(self, x: np.ndarray, x0: np.ndarray) -> np.ndarray:
        """One value per hard particle, positive while it is less than reach / 2 from where it was
        at x0."""
        if not self.certified:
            return np.empty(0)
        moved = x - x0
        return np.concatenate([0.25 * self.reach**2 - (moved[c] ** 2).sum(1) for c in self._hard])
