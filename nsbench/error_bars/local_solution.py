"""Local solution of the constrained motion over an interval in which contacts close or open.

From a feasible state the motion goes on with the velocity that is the drift's projection on the
cone of velocities which violate nothing (Moreau), until a gap closes or a multiplier vanishes. The
times are found by bisection and by Brent's method. In between it is smooth: a piece is a cubic
Hermite polynomial through one step of the classical Runge-Kutta method. An interval is divided into
more pieces until their residual counts no longer beside the run's own error.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from nsbench.dynamics.contacts.candidates import ANCHOR, PAIR
from nsbench.error_bars.contact_rows import ContactRows, least_change, size
from nsbench.error_bars.shadow import (
    CLOSED,
    HIDDEN,
    HIDDEN_WEIGHTS,
    NEWTON,
    OUTSIDE,
    PULL,
    REPAIRS,
    Shadow,
    Stretch,
    bezier,
    bezier_middle,
    boole,
    doubt,
    hermite,
    upper_mean,
)

PIECES = (1, 4)  # of an interval, beside those that events make
SMALL = 0.1  # of the run's error over the interval: a residual that needs no more pieces
MOST_PIECES = 200
STIFF = 1.0  # rate of the drift times the length of a piece that is resolved
STIFFEST = 50.0  # and of one that is not divided for it
CLOSING = 45  # bits of a piece to which the time is known at which a gap closes
RELEASE = 20  # and at which a multiplier vanishes, which needs less: the motion has no kink there
LOOKS = np.arange(1, 17) / 16.0  # of a piece, where a gap may be found closed
PLACES = np.arange(5) / 4.0  # of a piece, where its residual is computed


@dataclass(frozen=True)
class LocalSolution:
    """Where a local solution ends: state (n,), bound of the integral of its residual, integral
    (n,) of the drift along it and its doubt, its pieces, and whether it got to the end of its
    interval.
    """

    state: np.ndarray
    residual: float
    drift: np.ndarray
    doubt: float
    pieces: list[Stretch]
    is_complete: bool


def local_solution(
    shadow: Shadow, t: float, H: float, y: np.ndarray, target: np.ndarray, most: int = MOST_PIECES
) -> LocalSolution:
    """Integrate over [t, t + H] from the state y (n,) of S, in at most so many pieces.

    target (n,): where the run went.
    """
    for pieces in PIECES:
        found = _in_pieces(shadow, t, H, y, pieces, most)
        error = size(target - found.state)
        if not found.is_complete or found.residual <= SMALL * error + CLOSED:
            break
    return found


def _in_pieces(
    shadow: Shadow, t: float, H: float, y: np.ndarray, pieces: int, most: int
) -> LocalSolution:
    ends = t + H * np.arange(1, pieces + 1) / pieces
    now = t
    closed: Sequence[tuple] = ()
    total = np.zeros_like(y)
    unsure = 0.0
    at = 0
    found: list[Stretch] = []
    for _ in range(most):
        piece = _Piece(shadow, now, float(ends[at]) - now, y)
        closed = piece.closed.ids
        stretch, along, part = piece.end()
        unsure += part
        found.append(stretch)
        y = stretch.end
        total += along
        now += piece.length
        if not piece.is_cut or now >= ends[at]:
            now = float(ends[at])
            at += 1
            if at == pieces:
                break
    left = t + H - now if at < pieces else 0.0
    if left > 0.0:
        # too many events: the curve waits where it is for the rest of the interval
        f = shadow.drift(now, y)
        total += left * f
        found.append(_waiting(now, left, y, left * float(np.linalg.norm(f)), closed))
    residual = sum(s.slack for s in found)
    return LocalSolution(y, residual, total, unsure, found, left == 0.0)


def _waiting(t: float, H: float, y: np.ndarray, slack: float, closed) -> Stretch:
    loads = np.empty((len(PLACES), 0))
    no_residual = np.empty((0, len(y)))
    states = np.array([y] * 4)
    return Stretch(t, H, states, y, (), loads, frozenset(closed), no_residual, slack)


class _Piece:
    """One smooth piece of a local solution: from y (n,) at t, over at most dt."""

    def __init__(self, shadow: Shadow, t: float, dt: float, y: np.ndarray):
        self.shadow = shadow
        self.t = t
        self.y = y
        self.length = dt
        self.is_cut = False
        self.pushing: np.ndarray | None = None  # (1, m): contacts with positive multipliers
        f = self._field(0.0, y)
        for _ in range(REPAIRS):
            self.listed = shadow.near_rows(self.y, 4.0 * dt * size(f) + CLOSED)
            self.gaps = self.listed.gaps(np.array([t]), self.y[None])[0]
            self.closed = shadow.part(self.listed, np.flatnonzero(self.gaps <= CLOSED))
            # what is closed up to CLOSED is closed up to rounding; the jump counts as residual
            if not self.closed.m or not self.closed.is_straight:
                break
            before = self.y
            self.y = self.closed.closed(np.array([t]), before[None])[0]
            if np.abs(self.y - before).max() <= CLOSED / 8.0:
                break
        self.jump = size(self.y - y)
        self.v, q = self._velocity(0.0, self.y, f)
        self._take_step()
        if self._stop_where_stiff():
            self._take_step()
        if self._stop_at_release(q):
            self._take_step()
        self._stop_at_closing()
        self._stop_at_violation(q)

    def _field(self, s, x):
        return self.shadow.drift(self.t + s, x)

    def _take_step(self):
        """Take one step of the classical Runge-Kutta method for the projected drift."""
        h = self.length
        slope = lambda s, x: self._velocity(s, x, self._field(s, x))[0]
        a = self.v
        b = slope(0.5 * h, self.y + 0.5 * h * a)
        c = slope(0.5 * h, self.y + 0.5 * h * b)
        d = slope(h, self.y + h * c)
        # what the drift does to the difference of two stages is its stiffness along them
        apart = 0.5 * h * size(b - a)
        self.rate = size(c - b) / apart if apart > 0.0 else 0.0
        self.step = h
        self.last = self.y + h / 6.0 * (a + 2.0 * (b + c) + d)
        self.last_v = slope(h, self.last)
        way = self.last - self.y
        bend = 3.0 * way - h * (2.0 * self.v + self.last_v)
        cubic = h * (self.v + self.last_v) - 2.0 * way
        self.powers = np.array([self.y, h * self.v, bend, cubic])

    def _stop_where_stiff(self) -> bool:
        """Shorten the piece to a step that is stable, unless that would take too many.

        The rate at which the drift draws neighbouring states together is seen from two stages of
        the step (Hairer & Wanner, Solving ODEs II, 1996, IV.2).
        """
        if not STIFF < self.length * self.rate <= STIFFEST:
            return False
        self.length = STIFF / self.rate
        self.is_cut = True
        return True

    def _states(self, s):
        """Return the states (K, n) at the times s (K,) of the piece: Horner's rule."""
        w = (s / self.step)[:, None]
        a, b, c, d = self.powers
        return a + w * (b + w * (c + w * d))

    def _curve(self, s):
        """Return the states (K, n) and velocities (K, n) at the times s (K,) of the piece."""
        w = s[:, None] / self.step
        return hermite(w, self.step, self.y, self.last, self.v, self.last_v)

    def _open_contacts(self) -> ContactRows:
        """Return the rows of the open contacts that may close along the curve of the step.

        A distance changes by at most twice the way of a particle: in a large scene that is far
        less than the way of the whole state, by which candidates were listed.
        """
        is_open = self.gaps > CLOSED
        if not (self.shadow.is_flat or self.listed.is_moving):
            way = np.abs(self._states(self.length * LOOKS) - self.y).max(axis=0)
            kind = self.listed.near.kind
            is_distance = (kind == PAIR) | (kind == ANCHOR)
            apart = 2.0 * np.sqrt(3.0) * way.max()
            # more than that: between the places that were looked at the curve may go further
            reach = np.where(is_distance, 2.0 * apart, 4.0 * size(way))
            is_open &= self.gaps <= reach + CLOSED
        return self.listed.take(np.flatnonzero(is_open))

    def _velocity(self, s, x, f) -> tuple[np.ndarray, np.ndarray]:
        """Project f on the velocities v with N v + rate >= 0; return v and the multipliers."""
        rows = self.closed
        if not rows.m:
            return f, np.empty(0)
        at = np.array([self.t + s])
        N = rows.gradients(at, x[None])
        if not rows.is_moving:
            # the contacts that pushed last are tried first
            rest, q = N.off_cone(-f[None], self.pushing)
            self.pushing = q > 0.0
            return -rest[0], q[0]
        rates = rows.rates(at, x[None])
        base = -N.normal_part(rates)
        if np.abs(N.times(base) + rates).max() > PULL * max(1.0, size(f)):
            # walls that move apart: no v keeps all closed
            return least_change(N.dense()[0], -rates[0], f)
        rest, q = N.off_cone(-(f - base), self.pushing)
        self.pushing = q > 0.0
        return base[0] - rest[0], q[0]

    def _stop_at_closing(self):
        """Shorten the piece to the time at which the first open contact closes."""
        self.open = self._open_contacts()
        if not self.open.m:
            return
        share = self.length / self.step
        if self.open.can_be_searched:
            end = self.open.first_closing(self.powers, share * LOOKS, 0.5 * CLOSED, CLOSING)
            if end < np.inf:
                self.length = end * self.step
                self.is_cut = True
            return
        looks = self.length * LOOKS
        late = next((s for s in looks[self._least_gap(looks) < 0.0]), None)
        if late is not None:
            above = lambda s: self._least_gap(np.array([s]))[0] - 0.5 * CLOSED
            self._cut(above, late, CLOSING)

    def _stop_at_violation(self, q):
        """Shorten the piece to before a flat contact is violated that is closed at its start and
        does not act: it opens and closes again."""
        resting = np.flatnonzero(~(q > 0.0))
        if not resting.size or not self.shadow.is_flat:
            return
        looks = self.length * LOOKS
        gaps = self.shadow.part(self.closed, resting).gaps(self.t + looks, self._states(looks))
        late = np.flatnonzero(gaps.min(axis=1) < -OUTSIDE)
        if late.size:
            self.length = float(looks[late[0] - 1] if late[0] else 0.5 * looks[0])
            self.is_cut = True

    def _least_gap(self, s):
        """Return (K,) the least gap of the open contacts at the times s (K,) of the piece."""
        return self.open.gaps(self.t + s, self._states(s)).min(axis=1)

    def _stop_at_release(self, q) -> bool:
        """Shorten the piece to the time at which the first acting multiplier vanishes."""
        acting = np.flatnonzero(q > 0.0)
        if not acting.size:
            return False
        rows = self.shadow.part(self.closed, acting)

        def least_load(s):
            X = self._states(s)
            N = rows.gradients(self.t + s, X)
            pull = N.times(self.shadow.fields(self.t + s, X)) + rows.rates(self.t + s, X)
            return N.multipliers(-pull).min(axis=1)

        first, last = least_load(np.array([0.0, self.length]))
        if not (first >= 0.0 and last < 0.0):
            return False
        self._cut(lambda s: least_load(np.array([s]))[0], self.length, RELEASE)
        return True

    def _cut(self, function, late, bits):
        """End the piece behind the first zero of `function`, by Brent's method to late / 2^bits.

        function: not negative at 0, negative at `late`, where it is negative at the end found.
        """
        step = late * 2.0**-bits
        end, _ = brentq(function, 0.0, late, xtol=step, full_output=True, disp=False)
        if not 0.0 <= end <= late:  # the drift is not finite in between
            end = late
        while end < late and not function(end) < 0.0:
            end = min(late, end + step)
            step *= 2.0
        self.length = end
        self.is_cut = True

    def end(self) -> tuple[Stretch, np.ndarray, float]:
        """Return the piece as a stretch, the integral (n,) of the drift along it, and its doubt."""
        s = self.length * PLACES
        X, dX = self._curve(s)
        _, q = self._velocity(s[2], X[2], self._field(s[2], X[2]))
        rows = self.shadow.part(self.closed, np.flatnonzero(q > 0.0))
        controls = bezier(X[0], X[-1], self.length * dX[0], self.length * dX[-1])
        if rows.m:
            on = rows.closed(self.t + s, X, 1 if rows.is_straight else NEWTON)
            if rows.is_straight:  # no part of the residual knows of the shift
                self.jump += float(np.abs(np.diff(on - X, axis=0)).sum())
            X = on
        controls += X[2] - bezier_middle(controls)
        F = self.shadow.fields(self.t + s, X)
        hidden = self.length * np.array(HIDDEN)
        found = self.shadow.fields(self.t + hidden, self._states(hidden))
        off = found - np.array(HIDDEN_WEIGHTS) @ F
        unseen = self.length * float(np.linalg.norm(off, axis=1).max())
        rest = dX - F
        loads = np.empty((len(s), 0))
        if rows.m:
            N = rows.gradients(self.t + s, X)
            # the normal velocity is that of the face, whatever the polynomial's is
            lack = N.times(dX) + rows.rates(self.t + s, X)
            rest, loads = N.off_cone(rest - N.normal_part(lack))
        sizes = np.linalg.norm(rest, axis=1)
        stretch = Stretch(
            t=self.t,
            H=self.length,
            states=controls,
            end=X[-1],
            ids=rows.ids,
            loads=loads,
            closed=frozenset(self.closed.ids),
            residual=np.empty((0, len(self.y))),
            slack=self.jump + unseen + self.length * upper_mean(sizes),
        )
        return stretch, self.length * boole(F), self.length * doubt(F) + unseen
