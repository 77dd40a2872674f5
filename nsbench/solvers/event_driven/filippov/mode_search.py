"""Search for the mode in which a Filippov motion continues from a point on switching surfaces.

Every mode of the surfaces reached is a candidate: off a surface if the motion leads away from it,
on it if the weights that hold it there lie in [0, 1]. Where the first derivative vanishes
(tangential exits) a short trial motion decides. No candidate, or several with different motions,
is an answer: the run says so and stops.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np

from nsbench.case.scale import time_text
from nsbench.case import Case
from nsbench.dynamics.filippov.vector_field import EPS, FREE, FilippovVectorField
from nsbench.trajectory import Status

# lengths of trial motions as parts of the case's own time: the first sign shown decides
TRIALS = 10.0 ** np.arange(-7, -2)
LONGEST_TRIAL = 1e-3  # of the run, where the shorter ones show no sign
LOCATED = 1e-9  # of the own time: within it lies an event of a switch that is not continuous
BISECTIONS = 64  # of that interval: to neighbouring numbers
FLAT = 1e-7  # relative size below which a first derivative decides nothing
SAME_MOTION = 1e-12  # relative difference of trial states below which two motions are one
OUTGROWN = 2.0  # times a start's value, which is known to FLAT, a trial tells which motion lasts
NEAR_SURFACE = 1e3  # roundings of c_i within which a point counts as on the surface


def surface_names(rows) -> str:
    """Return the surfaces `rows` as words for a message."""
    return f"surface {rows[0]}" if len(rows) == 1 else f"surfaces {', '.join(map(str, rows))}"


def rounding_band(
    field: FilippovVectorField, t: float, x: np.ndarray, times: float = NEAR_SURFACE
) -> np.ndarray:
    """Return (d,) what rounding and the location of events leave of each c_i on its surface:
    `times` roundings of its terms."""
    G = field.gradients(t, x, np.arange(field.d))
    pace = np.abs(field.along(t, x, 1.0, np.zeros(x.size)))  # a surface that only time moves rounds
    return times * EPS * (np.abs(G) @ (1.0 + np.abs(x)) + pace * (1.0 + abs(t)))


def jump_time(
    field: FilippovVectorField, t: float, x: np.ndarray, mode: np.ndarray, surfaces, case: Case
) -> tuple[float, list[int]]:
    """Return when a switch of `surfaces` jumped over zero in time, near t, and which ones did.

    A ramp does at the end of its period: its surface is passed without being met. The jump is
    bisected, at the state x (n,), to the rounding of the time. mode (d,): before it.
    """
    low = t - LOCATED * case.own_time
    high = min(t + LOCATED * case.own_time, float(case.t[-1]))
    side = lambda t: mode * field.switch(t, x)
    crossed = (np.abs(mode) == 1) & (side(low) > 0.0) & (side(high) < 0.0)
    rows = [int(i) for i in surfaces if crossed[i]]
    if not rows:
        return t, []
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        if np.all(side(middle)[rows] > 0.0):
            low = middle
        else:
            high = middle
    band = rounding_band(field, t, x)
    before = side(low)
    after = side(high)
    return high, [i for i in rows if before[i] > band[i] and after[i] < -band[i]]


@dataclass(frozen=True)
class Continuation:
    """A mode (d,) in which a motion continues, its signs (d,), trial states ahead (k, n), and
    whether it goes on longer than what its start is known to."""

    mode: np.ndarray
    signs: np.ndarray
    ahead: np.ndarray
    lasts: bool


def _is_one_motion(found: list[Continuation]) -> bool:
    """Do all go the same way?"""
    ahead = found[0].ahead
    most = SAME_MOTION * (1.0 + np.nanmax(np.abs(ahead)))
    # trials that lead where weights are lost are not numbers; the shorter ones decide then
    return all(np.nanmax(np.abs(other.ahead - ahead)) <= most for other in found[1:])


@dataclass
class ModeSearch:
    """Choice of the mode of a motion. span: the case's own time; length: of the run."""

    field: FilippovVectorField
    span: float
    length: float

    def choose(
        self, t: float, x: np.ndarray, mode: np.ndarray, signs: np.ndarray, met: np.ndarray
    ) -> tuple[Status, np.ndarray | None, np.ndarray | None]:
        """Choose the mode that continues from (t, x) on the surfaces `met`, sliding first.

        mode (d,): of the other surfaces; signs (d,): guess of the signs. Returns a status, the mode
        and its signs.
        """
        size, known, s = self._largest_rates(t, x, mode, signs, met)
        continuing = list(self._continuing(t, x, mode, met, size, known, s))
        if not continuing:
            return self._no_motion(t, met, known), None, None
        if not _is_one_motion(continuing):
            # one that ends within what its start is known to goes on as another one of them
            continuing = [c for c in continuing if c.lasts]
        if not continuing or not _is_one_motion(continuing):
            several = Status(
                "degenerate",
                f"At t = {time_text(t)} several motions continue from {surface_names(met)}: "
                "the solution is not unique there.",
            )
            return several, None, None
        return Status(), continuing[0].mode, continuing[0].signs

    def _largest_rates(self, t, x, mode, signs, met):
        """(d,) the largest |c_i'| off the surfaces met; are all fields there finite; signs of the
        last one."""
        mode = mode.copy()
        size = np.zeros(self.field.d)
        known = True
        s = signs
        for q in product((1, -1), repeat=met.size):
            mode[met] = q
            F, s = self.field.velocity(t, x, mode, signs)
            known = known and bool(np.all(np.isfinite(F)))
            size = np.fmax(size, np.abs(self.field.along(t, x, 1.0, F)))
        return size, known, s

    def _continuing(self, t, x, mode, met, size, known, s) -> Iterator[Continuation]:
        """Modes and signs in which a motion continues, with its trial states."""
        modes_of = [
            (FREE, 1, -1) if known and self.field.fields_agree(t, x, s, i) else (0, 1, -1)
            for i in met
        ]
        for q in product(*modes_of):
            candidate = mode.copy()
            candidate[met] = q
            for signs in self.field.sliding_solutions(
                t, self._projected(t, x, candidate), candidate
            ):
                found = self._trial_states(t, x, candidate, signs, met, size)
                if found is not None:
                    yield Continuation(candidate, signs, *found)

    @staticmethod
    def _no_motion(t, met, known) -> Status:
        if known:
            return Status(
                "degenerate",
                f"At t = {time_text(t)} no motion continues from {surface_names(met)}.",
            )
        return Status(
            "nan", f"The drift is not finite on {surface_names(met)} at t = {time_text(t)}."
        )

    def _projected(self, t, x, mode):
        on = np.flatnonzero(mode == 0)
        return self.field.project(t, x, on) if on.size else x

    def _trial_states(self, t, x, mode, s, met, size):
        """Trial states if the mode with signs s has a motion from (t, x), and does it last? None
        if it has none. size (d,): largest |c_i'| off the surfaces."""
        field = self.field
        x = self._projected(t, x, mode)
        F, s = field.velocity(t, x, mode, s)
        if not (np.all(np.isfinite(s)) and np.all(np.isfinite(F))):
            return None
        value = np.zeros(field.d)
        rate = field.along(t, x, 1.0, F)
        for i in met:
            if mode[i] == 0:
                value[i] = 1.0 - abs(s[i])
            else:
                outward = -abs(rate[i]) if mode[i] == FREE else mode[i] * rate[i]
                value[i] = outward / (size[i] or 1.0)
        if np.any(value[met] < -FLAT):
            return None
        undecided = [i for i in met if value[i] <= FLAT]
        first = np.zeros(len(undecided))  # signs that trials show first
        later = np.zeros(len(undecided))  # and where they outgrow what is known at the start
        ahead = []
        for h in self._trial_lengths():
            after, state, weights = self._trial(mode, t, x, s, h)
            if len(ahead) < TRIALS.size:
                ahead.append(state)
            elif np.all(first != 0.0) or not np.all(np.isfinite(state)):
                break
            c = field.switch(after, state)
            band = rounding_band(field, after, state)
            for k, i in enumerate(undecided):
                start = 0.0
                if mode[i] == FREE:
                    v = self._stays_free(mode, t, x, s, h, i, after, state, weights, c, band)
                    least = 0.0
                elif mode[i] == 0:
                    v = 1.0 - abs(weights[i])
                    least = 1e-2 * FLAT
                    start = abs(value[i])
                else:
                    v = mode[i] * c[i]
                    least = band[i] / 10
                    start = abs(value[i]) * size[i] * h
                if first[k] == 0.0 and abs(v) > least:
                    first[k] = np.sign(v)
                if later[k] == 0.0 and abs(v) > max(least, OUTGROWN * start):
                    later[k] = np.sign(v)
        return None if np.any(first < 0.0) else (np.array(ahead), not np.any(later < 0.0))

    def _trial_lengths(self) -> Iterator[float]:
        """Lengths of trial motions: TRIALS of the own time, then longer ones."""
        yield from TRIALS * self.span
        longest = LONGEST_TRIAL * self.length
        h = TRIALS[-1] * self.span
        while h < longest:
            h = min(10.0 * h, longest)
            yield h

    def _stays_free(self, mode, t, x, s, h, i, after, state, weights, c, band) -> float:
        """-1 if the trial leaves surface i or the two fields differ at its end, else 0."""
        off = abs(c[i]) - band[i]
        if off > 0.0:  # the difference to two half steps is the error of the trial
            _, other, _ = self._trial(mode, *self._trial(mode, t, x, s, h / 2), h / 2)
            off -= 4.0 * abs(c[i] - self.field.switch(after, other)[i])
        return -1.0 if off > 0.0 or not self.field.fields_agree(after, state, weights, i) else 0.0

    def _trial(self, mode, t, x, s, h):
        """(time, state, signs) after one classical Runge-Kutta step of length h from (t, x, s) in
        the mode."""
        v = self.field.velocity
        k1 = v(t, x, mode, s)[0]
        k2 = v(t + h / 2, x + h / 2 * k1, mode, s)[0]
        k3 = v(t + h / 2, x + h / 2 * k2, mode, s)[0]
        k4 = v(t + h, x + h * k3, mode, s)[0]
        y = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        return t + h, y, v(t + h, y, mode, s)[1]
