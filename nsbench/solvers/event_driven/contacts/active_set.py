"""Which of the closed contacts act from now on: the complementarity problem of velocities, with
look-ahead.

A contact with neither multiplier nor opening speed is undecided; so is every contact at the instant
of its release, and one that touches tangentially. The velocity problem is then solved a little
later along the flow, at times that grow until every decision is strict. Without that, releases
chatter.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nsbench.solvers.event_driven.contacts.evaluation import ContactField, Rows
from nsbench.solvers.event_driven.contacts.gram_matrix import gram_of

DEPENDENT = 1e-10  # squared sine of the angle between a gradient and those held
UNDECIDED = 1e-7  # speeds and multipliers this small, relative to the drift, are looked at ahead
FLAT = 1e-8  # gradients this short, relative to their start, count as zero
STRICT = 1e-12  # larger ones ahead count as decided: a thousand times rounding
AHEAD = 10.0 ** np.arange(-5, 0)  # times looked ahead, in steps of the integrator
AGREE = 1e-3  # a multiplier may start this negative relative to the drift if it is strict ahead


@dataclass(frozen=True, eq=False)
class ActiveSet:
    """basis: indices of independent contacts to hold; kept: mask of those that stay closed with
    them.

    stuck: index of a contact no velocity can satisfy, or -1. flat: its gradient vanishes or is not
    finite.
    """

    basis: np.ndarray
    kept: np.ndarray
    stuck: int = -1
    flat: bool = False


class ActiveSetSelector:
    """Chooses bases; remembers the size of the drift, which sets what is small."""

    def __init__(self, field: ContactField):
        self.field = field
        self.size = 0.0
        self.solved = 0
        self.iterations = 0
        self.patterns: dict = {}

    def measure(self, t, x, rows: Rows, step):
        """Update the running size of speeds: |f| and |dg/dt| here and a step later."""
        for s in (t, t + step):
            f = self.field.drift(s, x)
            rate = self.field.rates(s, x, rows) / rows.norm
            size = max(np.abs(f).max(initial=0.0), np.abs(rate).max(initial=0.0))
            if np.isfinite(size):
                self.size = max(self.size, size)

    def velocity(self, t, x, rows: Rows, warm, strictly=True):
        """Solution of the velocity problem: (lam, w, support, code, bad), its Gram matrix, x'."""
        M, h, (C, V, count, v) = self._problem(t, x, rows)
        tol = 1e-14 * (np.abs(h).max(initial=0.0) + self.size * M.norm) + (
            0.0 if strictly else 1e-12 * self.size * M.norm
        )
        from nsbench.solvers.event_driven.contacts.kernels.constraint_rows import add_transposed

        *solution, its = M.solve(h, np.asarray(warm, np.int64), tol, DEPENDENT, self.size)
        self.solved += 1
        self.iterations += its
        add_transposed(C, V, count, solution[0], v)
        return solution, M, v

    def _problem(self, t, x, rows):
        """Gram matrix and right-hand side h = G f + dg/dt of the velocity problem; the gradients
        and f."""
        from nsbench.solvers.event_driven.contacts.kernels.constraint_rows import times

        C, V, count = self.field.gradients(t, x, rows)
        f = np.array(self.field.drift(t, x), float)
        return (
            gram_of(C, V, count, f.size, self.patterns),
            times(C, V, count, f) + self.field.rates(t, x, rows),
            (C, V, count, f),
        )

    def choose(self, t: float, x: np.ndarray, rows: Rows, warm, step: float) -> ActiveSet:
        """rows: the closed contacts; warm: indices to prefer; step: a step of the integrator, the
        time scale."""
        m = len(rows)
        none = np.zeros(m, bool)
        self.measure(t, x, rows, step)
        (lam, w, support, code, bad), M, _ = self.velocity(t, x, rows, warm)
        norm = M.norm
        flat = np.flatnonzero(~(norm >= FLAT * rows.norm))
        if flat.size:
            return ActiveSet(support, none, int(flat[0]), True)
        if code == 1:  # by rounding alone? Ask with a tolerance
            (lam, w, support, code, bad), M, _ = self.velocity(t, x, rows, warm, strictly=False)
        if code == 1:
            return ActiveSet(support, none, int(bad))
        small = UNDECIDED * self.size
        shut = np.flatnonzero(w <= small * norm)
        strong = support[lam[support] * norm[support] > small]
        if len(strong) == len(shut):
            return ActiveSet(strong, _mask(m, strong))
        return self._look_ahead(t, x, rows, shut, support, step, lam * norm, M)

    def _look_ahead(self, t, x, rows, shut, support, step, strength, M):
        part = self.field.take(rows, shut)
        place = {int(k): a for a, k in enumerate(shut)}
        warm = [place[int(k)] for k in support if int(k) in place]
        best = np.array([k for k in support if strength[k] > UNDECIDED * self.size], np.int64)
        for delta in step * AHEAD:
            y = self._ahead(t, x, part, warm, delta)
            if y is None:
                continue
            (lam, w, held, code, _), M2, _ = self.velocity(t + delta, y, part, warm)
            if code == 1 or not np.all(np.isfinite(lam)):
                continue
            norm = M2.norm
            held = held[lam[held] * norm[held] > STRICT * self.size]
            if not self._holds(t, x, part, held):
                continue
            best = shut[held]
            if np.all((w > STRICT * self.size * norm) | M2.span(held, DEPENDENT)):
                break
        kept = _mask(len(rows), shut) & M.span(best, DEPENDENT)
        return ActiveSet(best, kept)

    def _holds(self, t, x, part, held) -> bool:
        """Whether the multipliers of this basis are not negative now, beyond what the look-ahead
        may miss."""
        if not held.size:
            return True
        rows = self.field.take(part, held)
        M, h, _ = self._problem(t, x, rows)
        return bool(np.all(M.hold(h) * rows.norm >= -AGREE * self.size))

    def _ahead(self, t, x, part, warm, delta):
        """Where the flow is after delta, by one Runge-Kutta step with the velocity problem in every
        stage."""
        k = np.zeros_like(x)
        total = np.zeros_like(x)
        for c, weight in ((0.0, 1 / 6), (0.5, 1 / 3), (0.5, 1 / 3), (1.0, 1 / 6)):
            (lam, _, held, code, _), _, k = self.velocity(
                t + c * delta, x + c * delta * k, part, warm
            )
            if code == 1 or not np.all(np.isfinite(lam)):
                return None
            warm = held
            total += weight * k
        return x + delta * total


def _mask(m, index):
    out = np.zeros(m, bool)
    out[index] = True
    return out
