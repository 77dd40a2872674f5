"""Comparison curve Y of a run: feasible states near the recorded ones, smooth arcs between them.

Between two recorded times at which the same contacts act, the curve is a cubic Hermite polynomial
with the velocities of the exact motion on the face of these contacts at its ends, moved onto the
face along its normals. What it lacks to be a solution is the residual rho = Y' - f - N^T q, q >= 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from nsbench.dynamics.contacts.constraint_set import ConstraintSet
from nsbench.error_bars.contact_rows import ContactRows
from nsbench.error_bars.drift import Drift
from nsbench.error_bars.kernels.case_rows import CLOSED, REPAIRS
from nsbench.error_bars.kernels.cone_projection import PULL
from nsbench.error_bars.kernels.cubic import (
    BEYOND_SIMPSON,
    BOOLE,
    HIDDEN,
    HIDDEN_WEIGHTS,
    QUARTERS,
)
from nsbench.error_bars.kernels.local_piece import NEWTON, OUTSIDE
from nsbench.error_bars.scene_kernels import SceneKernels

MOST_ROWS = 2_000  # constraints that are all looked at
PEAK = 1.25  # times the largest residual at QUARTERS: one between them is less
BETWEEN = (0.125, 0.375, 0.625, 0.875)  # where it must be in S as well


class Shadow:
    """Feasible states near recorded ones, and the residual of smooth arcs between them.

    scene: the constraints; drift: f(t, x). All states are in own units.
    """

    def __init__(self, scene: ConstraintSet, drift: Drift):
        self.scene = scene
        self.drift = drift
        self._rows: dict[tuple, ContactRows] = {}
        self._static = ContactRows(scene, scene.all_static().ids)
        # only these are looked at between the places where residuals are computed
        self._has_flat = bool(self._static.m) or any(c.dim == 1 for _, c, _ in scene.hard)
        pairs = sum(m * (m - 1) // 2 for _, _, m in scene.hard)
        # few faces, all flat: then all are looked at wherever one may close
        self.is_flat = all(c.dim == 1 for _, c, _ in scene.hard)
        self.is_flat &= pairs + len(scene.all_static()) <= MOST_ROWS
        self._all: ContactRows | None = None

    def rows(self, ids: Sequence[tuple]) -> ContactRows:
        """Return the rows of the contacts `ids`, made once."""
        key = tuple(ids)
        if key not in self._rows:
            self._rows[key] = ContactRows(self.scene, key)
        return self._rows[key]

    def all_rows(self) -> ContactRows:
        """Return the rows of all constraints, for scenes with few of them."""
        if self._all is None:
            origin = np.zeros(self.scene.n)
            self._all = self.rows(self.scene.near(origin, np.inf, 0.0).ids)
        return self._all

    @cached_property
    def kernels(self) -> SceneKernels:
        """Return the kernels that call the functions of the case."""
        return SceneKernels(self.scene, self.drift, self.all_rows() if self.is_flat else None)

    def fields(self, t: np.ndarray, X: np.ndarray) -> np.ndarray:
        """Return (K, n) the drift at K states."""
        return self.drift.at(t, X)

    def least_gaps(self, t: np.ndarray, X: np.ndarray) -> np.ndarray:
        """Return (K,) the smallest gap of any constraint, 0.0 where none is violated."""
        if self.is_flat:
            return self.all_rows().gaps(t, X).min(axis=1, initial=0.0)
        worst = np.minimum(self._static.gaps(t, X).min(axis=1, initial=0.0), 0.0)
        # in the plane a pair that is violated but does not act is left to the local solutions
        if any(c.dim == 1 for _, c, _ in self.scene.hard):
            hard = [-self.scene.max_violation(float(s), x) for s, x in zip(t, X, strict=True)]
            worst = np.minimum(worst, hard)
        return worst

    def holds(self, t: np.ndarray, X: np.ndarray) -> bool:
        """Are all states (K, n) in S?"""
        return bool(np.all(self.least_gaps(t, X) >= -OUTSIDE))

    def feasible(self, t: np.ndarray, X: np.ndarray, ids: Sequence[tuple]) -> np.ndarray:
        """Return states (K, n) of S near X in which the contacts `ids` are closed."""
        rows = self.rows(ids)
        rounds = 1 if rows.is_straight else NEWTON
        Y = rows.closed(t, X, rounds)
        for k in np.flatnonzero(self.least_gaps(t, Y) < -CLOSED):
            Y[k] = self._repaired(t[k : k + 1], X[k : k + 1], list(ids))[0]
        return Y

    def _repaired(self, t, x, ids):
        """Close what is violated at the state x (1, n) as well, until nothing is."""
        y = x
        for _ in range(REPAIRS):
            rows = self.rows(ids)
            y = rows.closed(t, x, 1 if rows.is_straight else NEWTON)
            near = self.scene.near(y[0], 0.0, float(t[0]))
            g = self.scene.gaps(float(t[0]), y[0], near)
            more = [near.ids[k] for k in np.flatnonzero(g < -CLOSED) if near.ids[k] not in ids]
            if not more:
                break
            ids += more
        return y

    def velocities(self, t: np.ndarray, Y: np.ndarray, F: np.ndarray, rows: ContactRows):
        """Return (K, n) the velocities with which all contacts `rows` stay closed."""
        if not rows.m:
            return F
        N = rows.gradients(t, Y)
        return F - N.normal_part(N.times(F) + rows.rates(t, Y))

    def arcs(self, t: np.ndarray, H: np.ndarray, Y0, Y1, F0, F1, ids: Sequence[tuple]) -> Arcs:
        """Return the K arcs that begin at times t (K,), last H (K,), and lead from Y0 to Y1.

        F0, F1 (K, n): the drift at their ends; ids: the contacts that are closed on all of them.
        """
        rows = self.rows(ids)
        V0 = self.velocities(t, Y0, F0, rows)
        V1 = self.velocities(t + H, Y1, F1, rows)
        residual = np.empty((len(QUARTERS), *Y0.shape))
        field = np.empty_like(residual)
        inside = np.ones(len(t), bool)
        q = np.zeros((len(QUARTERS), len(t), rows.m))
        pace = np.zeros_like(q)  # of the faces
        for e, w in enumerate(QUARTERS):
            P, dP = hermite(w, H[:, None], Y0, Y1, V0, V1)
            s = t + w * H
            if rows.m and not (rows.is_straight and not rows.is_moving):
                P = rows.closed(s, P)
            inside &= self.least_gaps(s, P) >= -OUTSIDE
            if rows.m and rows.is_straight:
                # both sides of a slab may act in one interval: no state closes both
                inside &= np.abs(rows.gaps(s, P)).max(axis=1) <= OUTSIDE
            field[e] = {0.0: F0, 1.0: F1}[w] if w in (0.0, 1.0) else self.fields(s, P)
            rest = dP - field[e]
            if rows.m:
                N = rows.gradients(s, P)
                # the normal velocity is that of the moving face, whatever the polynomial's is
                pace[e] = rows.rates(s, P)
                lack = N.times(dP) + pace[e]
                rest, q[e] = N.off_cone(rest - N.normal_part(lack))
            residual[e] = rest
            if w == 0.5:
                middle = P
        for w in BETWEEN if self._has_flat else ():
            P, _ = hermite(w, H[:, None], Y0, Y1, V0, V1)
            if rows.m and not (rows.is_straight and not rows.is_moving):
                P = rows.closed(t + w * H, P)
            inside &= self.least_gaps(t + w * H, P) >= -OUTSIDE
        # where a contact pulls at an end, the motion has left it: no arc
        pull = np.linalg.norm(residual[:: len(QUARTERS) - 1], axis=2).max(axis=0)
        inside &= pull <= PULL * np.maximum(1.0, np.linalg.norm(F0, axis=1))
        unseen = np.zeros(len(t))
        for w, weights in zip(HIDDEN, HIDDEN_WEIGHTS, strict=True):
            P, _ = hermite(w, H[:, None], Y0, Y1, V0, V1)
            s = t + w * H
            moves = rows.m and rows.is_moving
            P = rows.closed(s, P) if moves else P
            off = np.linalg.norm(self.fields(s, P) - np.tensordot(weights, field, axes=1), axis=1)
            if moves:
                rates = rows.rates(s, P) - np.tensordot(weights, pace, axes=1)
                off += np.linalg.norm(rates, axis=1)
            unseen = np.maximum(unseen, H * off)
        controls = bezier(Y0, Y1, H[:, None] * V0, H[:, None] * V1)
        controls += middle - bezier_middle(controls)
        return Arcs(residual, field, inside, q, controls, unseen)


@dataclass(frozen=True)
class Stretch:
    """Part of a comparison curve on which the same contacts act, from t over a length H.

    states (4, n): Bezier control points, whose hull holds the curve; end (n,): its last state;
    loads (5, m): multipliers of the unit gradients of the acting contacts `ids` at its quarters,
    ends included; closed: all contacts that are closed on it; residual (5, n): at its quarters, or
    (0, n); slack: bound of the integral of what residual does not hold.
    """

    t: float
    H: float
    states: np.ndarray
    end: np.ndarray
    ids: tuple
    loads: np.ndarray
    closed: frozenset
    residual: np.ndarray
    slack: float


class Arcs:
    """Residuals (5, K, n) and drifts (5, K, n) at QUARTERS of K arcs; `inside` (K,): is it in S?

    q (5, K, m): multipliers of unit gradients there; controls (4, K, n): Bezier control points;
    unseen (K,): integrals of what the drift is beside the polynomial through QUARTERS, as far as
    HIDDEN places show it.
    """

    def __init__(self, residual, field, inside, q, controls, unseen):
        self.residual = residual
        self.field = field
        self.inside = inside
        self.q = q
        self.controls = controls
        self.unseen = unseen

    def sizes(self, H: np.ndarray) -> np.ndarray:
        """Return (K,) upper estimates of the integrals of |rho|: Boole's rule, and how far it is
        from Simpson's."""
        sizes = np.linalg.norm(self.residual, axis=2)
        return H * (boole(sizes) + np.abs(BEYOND_SIMPSON @ sizes)) + self.unseen

    def peaks(self, H: np.ndarray) -> np.ndarray:
        """Return (K,) upper estimates of the largest |rho|."""
        return PEAK * np.linalg.norm(self.residual, axis=2).max(axis=0) + self.unseen / H

    def vectors(self, H: np.ndarray) -> np.ndarray:
        """Return (K, n) the integrals of rho by Boole's rule."""
        return H[:, None] * boole(self.residual)

    def fields(self, H: np.ndarray) -> np.ndarray:
        """Return (K, n) the integrals of the drift along the arcs by Boole's rule."""
        return H[:, None] * boole(self.field)

    def doubts(self, H: np.ndarray) -> np.ndarray:
        """Return (K,) how far the integrals of the drift are from those by Simpson's rule."""
        off = np.tensordot(BEYOND_SIMPSON, self.field, axes=1)
        return H * np.linalg.norm(off, axis=1) + self.unseen


def hermite(w, H, Y0, Y1, V0, V1):
    """Return the cubic Hermite polynomial and its derivative in time at the part w of H.

    Y0, Y1, V0, V1: states and velocities at its ends; w and H broadcast against them.
    """
    P = (1.0 + 2.0 * w) * (1.0 - w) ** 2 * Y0 + w * (1.0 - w) ** 2 * H * V0
    P += w * w * (3.0 - 2.0 * w) * Y1 - w * w * (1.0 - w) * H * V1
    dP = 6.0 * w * (1.0 - w) / H * (Y1 - Y0)
    dP += (1.0 - w) * (1.0 - 3.0 * w) * V0 - w * (2.0 - 3.0 * w) * V1
    return P, dP


def boole(values: np.ndarray) -> np.ndarray:
    """Return the mean over an interval of a function, from its values at the quarters (5, ...)."""
    return (BOOLE @ values.reshape(5, -1)).reshape(values.shape[1:])


def bezier(Y0, Y1, D0, D1) -> np.ndarray:
    """Return (4, ...) the control points of the cubic from Y0 to Y1 with the derivatives D0, D1."""
    return np.array([Y0, Y0 + D0 / 3.0, Y1 - D1 / 3.0, Y1])


def bezier_middle(points: np.ndarray) -> np.ndarray:
    """Return the cubic with these control points (4, ...) in the middle."""
    return (points[0] + 3.0 * (points[1] + points[2]) + points[3]) / 8.0
