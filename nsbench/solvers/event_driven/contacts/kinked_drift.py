"""Evaluate the drift of a constrained case with every abs, max and sign held on one branch.

These are the states of its kinks (event_driven.filippov.tracing.kinks, which the Filippov method
shares).

On an arc the drift is smooth: the program of its traced operations for the present states. The
watched functions of the kinks are further event functions, at whose event a state changes. Drifts
without kinks stay with numpy.
"""

from __future__ import annotations

import numpy as np

from nsbench.case.scale import time_text
from nsbench.solvers.event_driven.filippov.program import TracedPrograms
from nsbench.dynamics.interval_taylor import ORDER, Jet
from nsbench.trajectory import Status

FLAT = 1e-7  # relative size below which the rate of an argument decides nothing
SAME_DRIFT = 1e-12  # relative difference below which the drift is continuous at a kink


class KinkedDrift:
    """Drift with the states of its kinks."""

    def __init__(self, traced: TracedPrograms):
        from nsbench.solvers.event_driven.filippov.kernels import (
            enclosure,
            kink_branches,
            mode_choice,
        )

        self.kernels = kink_branches
        self.evaluate = mode_choice.evaluate_program
        self.interval_order = enclosure.ORDER
        self.interval = enclosure.enclose
        self.traced = traced
        self.programs = traced.programs
        self.n = traced.n
        self.count = len(traced.places)
        outs = self.programs.outs[0]
        self.rows = outs[: self.n]
        self.watched = outs[self.n : self.n + 2 * self.count]
        self.V = np.zeros((self.programs.rows, 1))
        self.G = np.zeros((self.count, self.n + 2))
        self.held = -1  # the kink that was just reached

    def begin(self, t: float, x: np.ndarray) -> None:
        """Set the states at the start of a run."""
        self.held = -1
        self.kernels.begin_kinks(self.programs, 0, float(t), x, self.V, self.G)

    def drift(self, t: float, x: np.ndarray) -> np.ndarray:
        """Evaluate the drift f(t, x), (n,), in the present states."""
        self.evaluate(self.programs, 0, float(t), np.ascontiguousarray(x), self.V)
        return self.V[self.rows, 0]

    def distances(self, t: float, x: np.ndarray) -> np.ndarray:
        """Evaluate the watched functions (2 K,), positive until a state changes."""
        self.evaluate(self.programs, 0, float(t), np.ascontiguousarray(x), self.V)
        return np.where(self.watched >= 0, self.V[self.watched, 0], 1.0)

    def bands(self, t: float, x: np.ndarray) -> np.ndarray:
        """Return what rounding leaves of each watched function, (2 K,)."""
        slopes = np.abs(self.G[:, : self.n + 1])
        size = slopes[:, :-1] @ (1.0 + np.abs(x)) + slopes[:, -1] * (1.0 + abs(t))
        return np.repeat(self.kernels.KINK_BAND * np.finfo(float).eps * size, 2)

    def rates(self, velocity: np.ndarray) -> np.ndarray:
        """Return the rates of the arguments (K,) at the point of the last `settle`, relative to
        their terms."""
        terms = self.G[:, : self.n] * velocity
        size = np.abs(terms).sum(axis=1) + np.abs(self.G[:, self.n])
        rate = terms.sum(axis=1) + self.G[:, self.n]
        return np.divide(rate, size, out=np.zeros_like(rate), where=size > 0.0)

    def settle(self, t: float, x: np.ndarray, velocity_of) -> Status:
        """Set the states in which the motion goes on from (t, x).

        velocity_of(t, x) -> (n,): in the present states. The status is degenerate if both sides
        lead to a jump of the drift.
        """
        self.kernels.place_kinks(self.programs, 0, self.held, float(t), x, self.V, self.G)
        band = self.bands(t, x)
        for _ in range(2 * self.count + 2):
            self.held = -1
            near = self.distances(t, x) <= band
            if not near.any():
                return Status()
            rates = np.repeat(self.rates(velocity_of(t, x)), 2)
            state = np.repeat(self.programs.kinks.state, 2)
            single = np.repeat(self.programs.kinks.spans[:, 1] == 1, 2)
            upper = np.arange(2 * self.count) % 2 == 1
            falls = near & (np.where(upper | (single & (state == 0)), -rates, rates) < -FLAT)
            if not falls.any():
                return Status()
            w = int(np.argmax(falls))
            self.kernels.cross_kink(self.programs, w)
        return Status(
            "degenerate",
            f"At t = {time_text(t)} the drift jumps at {self.traced.places[w // 2]} and both sides "
            "lead to the jump: write it as a switching surface of a Filippov system, whose sliding "
            "is defined.",
        )

    def cross(self, w: int, t: float, x: np.ndarray) -> bool:
        """Change the state of the kink whose watched function w fell at (t, x); does the drift
        jump?"""
        before = self.drift(t, x)
        self.kernels.cross_kink(self.programs, w)
        self.held = w // 2
        after = self.drift(t, x)
        size = np.maximum(np.abs(before), np.abs(after)).max(initial=0.0)
        return bool(np.any(np.abs(after - before) > SAME_DRIFT * size))

    def enclose(self, t: Jet, x: Jet) -> Jet:
        """Enclose the drift and the watched functions of the present states over the pieces of t
        and x."""
        n = self.n
        rows = np.concatenate([self.rows, self.watched[self.watched >= 0]])
        pieces = t.mid.shape[-2]
        mid = np.zeros((len(rows), pieces, ORDER + 1))
        rad = np.zeros_like(mid)
        M = np.zeros((self.programs.rows, self.interval_order + 1))
        R = np.zeros_like(M)
        for k in range(pieces):
            M[: n + 1] = 0.0
            R[: n + 1] = 0.0
            for row, jet in ((slice(0, n), x), (n, t)):
                M[row, : ORDER + 1] = jet.mid[..., k, :]
                R[row, : ORDER + 1] = jet.rad[..., k, :]
            self.interval(self.programs.ops, self.programs.nums, self.programs.first[0], n, M, R)
            mid[:, k] = M[rows, : ORDER + 1]
            rad[:, k] = R[rows, : ORDER + 1]
        return Jet(mid, rad)
