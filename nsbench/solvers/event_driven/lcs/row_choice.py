"""Choose the rows with w = 0 on which a linear complementarity system goes on after an event.

Every set of rows is a candidate whose constraints the state satisfies. A lam or w that vanishes
there is decided by short trial motions: the first sign that shows counts, which is the
lexicographic order of the derivatives. No candidate, or several with different motions, is a
result: the run stops with a status.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nsbench.case import Case
from nsbench.case.scale import time_text
from nsbench.dynamics.lcs import certainly_unique
from nsbench.solvers.event_driven.lcs.linear_flow import LinearFlow
from nsbench.solvers.event_driven.lcs.modes import Inputs, build_mode
from nsbench.trajectory import Status

MAX_ENUMERATED_ROWS = 6  # up to here all 2^m sets are candidates; beyond, those of implicit steps
FIRST_TRIAL = -8.0  # trial motions: powers of ten, from 1e-8 of the fastest time of the candidates
LONGEST_TRIAL = 1e-2  # to this part of the run: what vanishes so long counts as zero
ZERO_BAND = 1e-12  # of the terms of a sum: below, it is zero (4500 roundings)


@dataclass(frozen=True)
class Point:
    """Time t and state x (n,) at which rows are chosen; sizes: of states (n,), inputs (n + m,)."""

    t: float
    x: np.ndarray
    sizes: tuple[np.ndarray, np.ndarray]

    @property
    def state_size(self) -> np.ndarray:
        """Return the sizes of the states (n,)."""
        return self.sizes[0]

    @property
    def input_size(self) -> np.ndarray:
        """Return the sizes of the inputs u and q (n + m,)."""
        return self.sizes[1]


class RowChoice:
    """Choose the rows of the arcs of one run; the flow of each set of rows is built once.

    modes_tried: flows that were looked at. uniqueness_unknown: were there more rows than are
    enumerated, of a matrix for which it is not known whether another motion exists?
    """

    def __init__(self, case: Case, inputs: Inputs, method: str, tol: float):
        self.system = case.problem
        self.n, self.m = self.system.B.shape
        self.span = float(case.t[-1]) - float(case.t[0])
        self.inputs = inputs
        self.method = method
        self.tol = tol
        self.flows: dict = {}
        self.modes_tried = 0
        self.uniqueness_unknown = False

    def choose(
        self, point: Point, last: LinearFlow | None, band: float
    ) -> tuple[LinearFlow | None, Status]:
        """Choose the flow that continues the motion, fewest undecided signs first.

        last: the flow of the arc that ended at the point. band: of the terms of a sum; below, it is
        zero. Returns the flow and ok, or None and why there is none, or more than one.
        """
        candidates = self._candidate_rows(point, last)
        flows = [f for f in (self._flow(rows) for rows in candidates) if f is not None]
        self.modes_tried += len(flows)
        flows = [f for f in flows if _is_consistent(f, point, band)]
        fast = min([self.span, *(1.0 / f.fastest_rate for f in flows if f.fastest_rate > 0.0)])
        times = fast * 10.0 ** np.arange(
            FIRST_TRIAL, 1.0 + np.log10(LONGEST_TRIAL * self.span / fast)
        )
        good = [
            (left, len(f.mode.rows), f.mode.rows, f)
            for f in flows
            if (left := _count_undecided(f, point, band, times)) is not None
        ]
        if not good:
            return None, Status(
                "infeasible",
                f"At t = {time_text(point.t)} no lambda continues the motion without a jump of the "
                "state.",
            )
        first, *others = (g[-1] for g in sorted(good, key=lambda g: g[:3]))
        for other in others:
            if _motions_differ(first, other, point, times):
                return None, Status(
                    "degenerate",
                    f"At t = {time_text(point.t)} several motions continue (rows "
                    f"{list(first.mode.rows)} or {list(other.mode.rows)} act): the solution is not "
                    "unique there.",
                )
        return first, Status()

    def _candidate_rows(self, point, last):
        """List the sets of rows to try: all, or those of implicit steps of decreasing length."""
        if self.m <= MAX_ENUMERATED_ROWS:
            return [tuple(i for i in range(self.m) if (code >> i) & 1) for code in range(2**self.m)]
        from nsbench.lcp import lemke

        out = [] if last is None else [last.mode.rows]
        for h in self.span * 10.0 ** -np.arange(3.0, 9.0):
            W = np.linalg.inv(np.eye(self.n) - h * self.system.A)
            s = self.inputs(point.t + h, 0)[0]
            z = W @ (point.x + h * s[: self.n])
            G = h * W @ self.system.B
            M = self.system.D + self.system.C @ G
            r = self.system.C @ z + s[self.n :]
            a, b = lemke.scales(M)
            on = np.zeros(self.m, np.bool_)
            lam = np.zeros(self.m)
            if lemke.solve(M, r, a, b, on, lam, np.zeros(self.m))[0]:
                out.append(tuple(int(i) for i in np.flatnonzero(lam > 0.0)))
            if not self.uniqueness_unknown and not certainly_unique(M, G):
                self.uniqueness_unknown = True
        return list(dict.fromkeys(out))

    def _flow(self, rows):
        """Return the flow with w = 0 on the rows, built once; None if they do not determine lam."""
        if rows not in self.flows:
            found = build_mode(self.system, rows)
            self.flows[rows] = (
                None if found is None else LinearFlow(found, self.inputs, self.method, self.tol)
            )
        return self.flows[rows]


def _is_consistent(flow, point, band) -> bool:
    """Check that the state satisfies the constraints of the mode, with no lam or w negative."""
    off, size = flow.constraint_residual(point.t, point.x, point.sizes)
    if np.any(np.abs(off) > band * size):
        return False
    x = flow.project(point.t, point.x, point.state_size)
    f, size = flow.sign_functions_at(point.t, x, point.sizes)
    return bool(np.all(f >= -band * size))  # False where not finite


def _count_undecided(flow, point, band, times) -> int | None:
    """Count the lam and w that vanish on the trial motions too; None if one turns negative."""
    x = flow.project(point.t, point.x, point.state_size)
    f, size = flow.sign_functions_at(point.t, x, point.sizes)
    signs = np.where(f > band * size, 1, 0)
    for h in times:
        if np.all(signs > 0):
            break
        f, clear, _ = _trial(flow, point, x, h)
        if not np.all(np.isfinite(f)):
            return None
        signs = np.where((signs == 0) & clear, np.sign(f), signs)
        if np.any(signs < 0):
            return None
        if np.any(clear & (f < 0.0)):  # one that was positive: from here another set acts
            break
    return int(np.count_nonzero(signs == 0))


def _trial(flow, point, x, h):
    """Return lam and w after the time h in this mode, a mask of those above rounding, x."""
    X, _ = flow.collocate(point.t, x, h)
    f, size = flow.sign_functions_at(
        point.t + h, X[-1], (np.maximum(point.state_size, np.abs(X[-1])), point.input_size)
    )
    return f, np.abs(f) > ZERO_BAND * size, X[-1]


def _motions_differ(a, b, point, times) -> bool:
    """Check whether the motions of two modes differ while both are admissible."""
    xa, xb = (f.project(point.t, point.x, point.state_size) for f in (a, b))
    for h in times:
        fa, clear_a, ya = _trial(a, point, xa, h)
        fb, clear_b, yb = _trial(b, point, xb, h)
        if np.any(clear_a & (fa < 0.0)) or np.any(clear_b & (fb < 0.0)):
            return False
        if np.any(np.abs(ya - yb) > ZERO_BAND * point.state_size):
            return True
    return False
