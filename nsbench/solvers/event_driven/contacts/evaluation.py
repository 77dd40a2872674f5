"""Evaluate drift, gaps, gradients and multipliers of a Complementarity case for listed contacts.

With all of the listed contacts active,  x' = f + G^T lam,  (G G^T) lam = -(G f + dg/dt).
"""

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
from nsbench.dynamics.contacts.kernels.contact_arrays import Layout
from nsbench.dynamics.scaling.estimate import case_scale
from nsbench.problem import Affine, Distance, Smooth
from nsbench.solvers.event_driven.contacts.kinked_drift import KinkedDrift
from nsbench.dynamics.interval_taylor import SPACE, Jet

# Up to so many pairs of hard particles all are candidates, without a bound on the displacement.
MAX_UNCERTIFIED_PAIRS = 2000


@dataclass(frozen=True, eq=False)
class ContactRows:
    """Listed contacts with what the kernels need of their gradients.

    listed: m contacts. slot (m,): place of a smooth constraint among the smooth ones. smooth:
    those, or None. width: entries of the longest gradient. norm (m,): lengths of the gradients; of
    smooth constraints the length at the start.
    """

    listed: CandidateContacts
    slot: np.ndarray
    smooth: CandidateContacts | None
    width: int
    norm: np.ndarray

    def __len__(self) -> int:
        return len(self.listed)


class ContactField:
    """Evaluate drift and listed constraints of a case at (t, x); count the drift calls.

    certified: whether candidates are only those within `reach` of contact. length: characteristic
    length of the case.
    """

    def __init__(self, case: Case, constraints: ConstraintSet, kinks: KinkedDrift | None = None):
        from nsbench.compilation.factories import as_numpy

        self.constraints = constraints
        self.n = case.n
        self.calls = 0
        self.length = case_scale(case).length
        self._drift = as_numpy(case.problem.drift) if kinks is None else kinks.drift
        self._kinks = kinks
        families = constraints.families
        self._state_functions = [
            case.problem.drift,
            *[
                q
                for c in families
                if isinstance(c, Smooth)
                for q in (c.g, c.gradient, c.rate)
                if q is not None
            ],
        ]
        self._time_functions = [
            c.b if isinstance(c, Affine) else c.anchors
            for c in families
            if isinstance(c, (Affine, Distance)) and c.moving
        ]
        self._moving_b = any(isinstance(c, Affine) and c.moving for c in families)
        self._moving_anchors = any(isinstance(c, Distance) and c.moving for c in families)
        t0 = float(case.t[0])
        self.initial_layout = Layout(
            constraints.anchors(t0),
            constraints.ptr,
            constraints.cols,
            constraints.vals,
            constraints.b(t0),
        )
        pairs = sum(m * (m - 1) // 2 for _, _, m in constraints.hard)
        self.certified = pairs > MAX_UNCERTIFIED_PAIRS
        self.reach = (
            min((2 * r.min() for r in constraints.radii.values()), default=0.0)
            if self.certified
            else np.inf
        )
        self._smooth_norm = self._smooth_norms(t0, case.x0)
        self._hard = [
            c.start + np.arange(m * c.dim).reshape(m, c.dim) for _, c, m in constraints.hard
        ]

    def compile(self, t: float, x: np.ndarray, arcs: bool = True) -> None:
        """Load or compile the kernels on an empty list; arcs: also those of arcs in Python."""
        from nsbench.lcp.gram_lcp import in_span, solve_lcp
        from nsbench.solvers.event_driven.contacts.kernels.constraint_rows import (
            add_transposed,
            constrained_velocity,
            gram,
            gram_solve,
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
            constrained_velocity(C, V, count, x, v)

    def drift(self, t: float, x: np.ndarray) -> np.ndarray:
        """Evaluate the drift f(t, x), (n,)."""
        self.calls += 1
        return self._drift(t, x)

    def enclose(self, t: Jet, x: Jet) -> list[Jet]:
        """Enclose every function that the case provides: drift, smooth constraints, moving data."""
        of_state = self._state_functions
        drift = []
        if self._kinks is not None:
            of_state = of_state[1:]  # all but the drift
            drift = [self._kinks.enclose(t, x)]
        return (
            drift
            + [q(SPACE)(t, x) for q in of_state]
            + [q(SPACE)(t) for q in self._time_functions]
        )

    def candidates(self, t: float, x: np.ndarray) -> ContactRows:
        """List every contact that can become active before a particle has moved by reach / 2 from
        x (n,)."""
        return self.rows(self.constraints.near(np.ascontiguousarray(x), self.reach, t))

    def rows(self, near: CandidateContacts) -> ContactRows:
        """Return the listed contacts with widths and norms of their gradients."""
        smooth = near.kind == SMOOTH
        of_row = near.p[near.kind == ROW]
        width = max(
            1,
            int(2 * near.dim[near.kind > ROW].max(initial=0)),
            int(np.diff(self.constraints.ptr)[of_row].max(initial=0)),
            self.n if smooth.any() else 0,
        )
        norm = np.where(near.kind == PAIR, np.sqrt(2.0), 1.0)
        norm[near.kind == ROW] = 1.0 / np.sqrt(self.constraints.inv2[of_row])
        for k in np.flatnonzero(smooth):
            norm[k] = self._smooth_norm[(int(near.family[k]), int(near.i[k]))]
        return ContactRows(
            near, np.cumsum(smooth) - 1, near.take(smooth) if smooth.any() else None, width, norm
        )

    def _smooth_norms(self, t, x):
        """Return the length of the gradient of every smooth constraint at the start, by id.

        It says which values of the constraint are small.
        """
        if not any(isinstance(c, Smooth) for c in self.constraints.families):
            return {}
        listed = self.constraints.all_static()
        smooth = listed.take(listed.kind == SMOOTH)
        norm = np.linalg.norm(self.constraints.dense_gradients(t, x, smooth), axis=1)
        norm[~(norm > 0.0) | np.isinf(norm)] = 1.0
        return dict(zip(smooth.ids, norm.tolist(), strict=True))

    def take(self, rows: ContactRows, index: np.ndarray) -> ContactRows:
        """Return some of the listed contacts, by positions or by a mask."""
        near = rows.listed.take(index)
        return (
            self.rows(near)
            if rows.smooth is not None
            else ContactRows(near, rows.slot[index], None, rows.width, rows.norm[index])
        )

    def _anchors_and_rows(self, t):
        """Return the anchors at time t and the matrix of all affine rows as CSR."""
        layout = self.initial_layout
        anchors = self.constraints.anchors(t) if self._moving_anchors else layout.anchors
        return anchors, layout.ptr, layout.cols, layout.vals

    def gaps(self, t: float, x: np.ndarray, rows: ContactRows) -> np.ndarray:
        """Evaluate the gaps g, (m,)."""
        from nsbench.solvers.event_driven.contacts.kernels.constraint_rows import fill_gaps

        k = rows.listed
        g = np.empty(len(rows))
        b = self.constraints.b(t) if self._moving_b else self.initial_layout.b
        fill_gaps(
            k.kind,
            k.p,
            k.q,
            k.d,
            k.sign,
            k.dim,
            np.ascontiguousarray(x),
            *self._anchors_and_rows(t),
            b,
            g,
        )
        if rows.smooth is not None:
            g[k.kind == SMOOTH] = self.constraints.gaps(t, x, rows.smooth)
        return g

    def gradients(
        self, t: float, x: np.ndarray, rows: ContactRows
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Evaluate the gradients as short rows: columns, values (m, width) and counts (m,)."""
        from nsbench.solvers.event_driven.contacts.kernels.constraint_rows import fill_rows

        k = rows.listed
        dense = (
            np.zeros((0, self.n))
            if rows.smooth is None
            else self.constraints.dense_gradients(t, x, rows.smooth)
        )
        return fill_rows(
            k.kind,
            k.p,
            k.q,
            k.sign,
            k.dim,
            rows.slot,
            np.ascontiguousarray(x),
            *self._anchors_and_rows(t),
            dense,
            rows.width,
        )

    def rates(self, t: float, x: np.ndarray, rows: ContactRows) -> np.ndarray:
        """Evaluate the partial time derivatives of the gaps, (m,)."""
        return (
            self.constraints.rates(t, x, rows.listed)
            if self.constraints.moving
            else np.zeros(len(rows))
        )

    def constrained_velocity(
        self, t: float, x: np.ndarray, rows: ContactRows
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return x' (n,), multipliers (m,) and reaction (n,) with all of `rows` active.

        Their gradients must be independent.
        """
        from nsbench.solvers.event_driven.contacts.kernels.constraint_rows import (
            constrained_velocity,
        )

        f = self.drift(t, x)
        if not len(rows):
            return f, np.empty(0), np.zeros(self.n)
        return constrained_velocity(
            *self.gradients(t, x, rows), np.ascontiguousarray(f), self.rates(t, x, rows)
        )

    def project(self, t: float, x: np.ndarray, rows: ContactRows) -> np.ndarray | None:
        """Project x (n,) onto g = 0 of all `rows` by Newton's method along their gradients.

        Returns None if x is there up to rounding, or if the iteration fails.
        """
        from nsbench.solvers.event_driven.contacts.kernels.constraint_rows import (
            add_transposed,
            gram,
            gram_solve,
        )

        if not len(rows):
            return None
        y = x
        rounding = 2e-15 * (self.length + np.abs(x).max()) * rows.norm
        for _ in range(3):
            g = self.gaps(t, y, rows)
            if np.all(np.abs(g) <= rounding):
                break
            C, V, count = self.gradients(t, y, rows)
            y = y.copy()
            add_transposed(C, V, count, gram_solve(gram(C, V, count, self.n), -g), y)
        return None if y is x or not np.all(np.isfinite(y)) else y

    def displacement_margin(self, x: np.ndarray, x0: np.ndarray) -> np.ndarray:
        """Return (reach / 2)^2 - displacement^2 of every hard particle between x0 and x (n,).

        The candidates are certain to be all while every value is positive.
        """
        if not self.certified:
            return np.empty(0)
        moved = x - x0
        return np.concatenate([0.25 * self.reach**2 - (moved[c] ** 2).sum(1) for c in self._hard])
