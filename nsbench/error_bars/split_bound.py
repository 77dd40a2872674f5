"""Error bound along a curve in a polyhedron, in two parts: a known vector and the radius of a ball.

The error is w = Y - x, of the curve Y against the motion x.

Let a be the contacts that are closed along Y in an interval, or may be closed for x: those with
g_k(Y) <= |w|. Tangential to all of them, with the projection P, contact forces vanish, and

    (P w)' = P (f(Y) - f(x) + rho)

holds whatever the multipliers are: this part is carried on as a vector. The contacts fall into
groups whose gradients are orthogonal to one another. Of the part of w in the span of a group only
the size is known, and <w, N^T (q - Lambda)> <= 0 lets it shrink: where all of the group are closed
with q > 0, by kappa = min over k of q_k / |N^+ e_k| per unit of time, against what the drift brings
in from the rest of w. So the error is delta + z with a vector delta, and a radius of z for the
tangential part and for that of each group; into the tangential part flows what groups hold.

Where contacts act on x in another order than on Y, the direction of w would be lost so. There a
second local solution X is computed, from Y - delta: |X - x| grows as between any two curves in S,
from the radius, and Y - X is the new vector.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import groupby

import numpy as np

from nsbench.error_bars.contact_rows import ContactRows, size
from nsbench.error_bars.growth import Linear
from nsbench.error_bars.kernels.split_step import (
    LEAST,
    LONG,
    UNKNOWN,
    WIDENED,
    ErrorArrays,
    Faces,
    FlowArrays,
    Stretches,
    carry_split,
)
from nsbench.error_bars.local_solution import local_solution
from nsbench.error_bars.shadow import Stretch
from nsbench.error_bars.subspaces import Split
from nsbench.error_bars.unit_gradients import for_kernel

TOGETHER = 64  # arcs over which the kernel carries an error in one call


@dataclass(frozen=True)
class Known:
    """What is known of an error: it is delta (n,) + z, z of at most the sizes `radii` in the parts
    of a split."""

    delta: np.ndarray
    split: Split
    radii: np.ndarray

    @cached_property
    def radius(self) -> float:
        """Largest size of z."""
        return size(self.radii)

    @cached_property
    def size(self) -> float:
        """Largest size of the error."""
        return size(self.delta) + self.radius

    def radii_in(self, other: Split) -> np.ndarray:
        """Return the largest sizes of z in the parts of another split."""
        if other is self.split:
            return self.radii
        return np.minimum(self.radius, self.split.norms_in(other) @ self.radii)


@dataclass(frozen=True)
class Carried:
    """The error w of a curve at its nodes: delta (K, n) and the radius (K,) of the rest, or norm
    (K,) of all of it; and the integral of J w up to each node: pulled (K, n), and the size of the
    rest, unknown (K,)."""

    delta: np.ndarray
    pulled: np.ndarray
    radius: np.ndarray
    norm: np.ndarray
    unknown: np.ndarray


@dataclass(frozen=True)
class Run:
    """Arcs that follow one another, from an interval on, with the same contacts and drift."""

    first: int
    split: Split
    on: Stretches


class SplitBound:
    """The bound at the nodes of a path (nsbench.error_bars.bars.Path) over a polyhedron.

    rows: all constraints; split: by set of contacts.
    """

    def __init__(self, path, drift: Linear):
        self.path = path
        self.drift = drift
        self.rows: ContactRows = path.shadow.all_rows()
        self.place = {c: k for k, c in enumerate(self.rows.ids)}
        self.N = for_kernel(self.rows.constant_gradients(path.nodes.t[0], path.Y[0]))
        self._faces = Faces(self.N, self.rows.near.sign < 0)
        stretches = [s for j in range(len(path.H)) for s in path.stretches[j]]
        gaps = self._least_gaps(stretches)
        self._gaps = {id(s): g for s, g in zip(stretches, gaps, strict=True)}
        rates = np.array([drift.at(j).one_sided for j in range(len(path.H))])
        self._growth = np.exp(rates * path.H)
        self._added = path.added(rates)
        self._splits: dict[tuple, Split] = {}
        # by interval where the run of arcs that it belongs to ends
        self._ends: list[int] = []
        for _, same in groupby(range(len(path.H)), self._kind):
            places = list(same)
            self._ends += [places[-1] + 1] * len(places)
        self._runs: dict[int, Run | None] = {}

    def split(self, contacts: tuple, j: int) -> Split:
        """Return the subspaces of contacts, by their places among all rows, in interval j."""
        drift = self.drift.at(j)
        key = contacts, id(drift)
        if key not in self._splits:
            self._splits[key] = Split(contacts, self.N, drift)
        return self._splits[key]

    def carried(self, start: np.ndarray) -> Carried:
        """Carry the error start (n,) of the curve to all nodes."""
        K = len(self.path.nodes.t)
        out = Carried(*(np.zeros((K, len(start))) for _ in range(2)), *np.zeros((3, K)))
        known = Known(start, self.split((), 0), np.zeros(1))
        out.delta[0] = start
        out.norm[0] = np.linalg.norm(start)
        j = 0
        while j < K - 1:
            count, known = self._over_arcs(j, known, out)
            if not count:
                known = self._to_next(j, known, out)
            j += max(count, 1)
        return out

    def _kind(self, j: int) -> Hashable:
        """Return what the arcs of a run have in common; of any other interval j its number."""
        first, *more = self.path.stretches[j]
        is_arc = not more and len(first.residual)
        return (first.ids, first.closed, id(self.drift.at(j))) if is_arc else j

    def _run(self, j: int) -> Run | None:
        """Return the run of arcs that interval j belongs to; None if it is no arc."""
        last = self._ends[j]
        if last not in self._runs:
            is_arc = self._kind(j) != j
            self._runs[last] = self._made_run(j, last) if is_arc else None
        return self._runs[last]

    def _made_run(self, j: int, last: int) -> Run:
        arcs = [self.path.stretches[k][0] for k in range(j, last)]
        split = self.split(self._places(arcs[0]), j)
        to = slice(j, last)
        return Run(j, split, self._arrays(arcs, split, self._growth[to], self._added[to]))

    def _arrays(self, stretches: list[Stretch], split: Split, growth, added) -> Stretches:
        """Return what the kernel knows of stretches with the same acting contacts."""
        loads = np.array([s.loads for s in stretches])
        return Stretches(
            H=np.array([s.H for s in stretches]),
            rho=np.array([s.residual for s in stretches]),
            slack=np.array([s.slack for s in stretches]),
            gaps=np.array([self._gaps[id(s)] for s in stretches]),
            pulls=self.pulls(loads, stretches[0].ids, split),
            growth=growth,
            added=added,
        )

    def _places(self, at: Stretch) -> tuple:
        """Return the places among all rows of the contacts that are closed on a stretch."""
        return tuple(sorted(self.place[c] for c in at.closed))

    def _over_arcs(self, j: int, known: Known, out: Carried) -> tuple[int, Known]:
        """Carry what is known at node j over arcs of one run, as far as the kernel gets; return
        over how many, and what is known behind them."""
        run = self._run(j)
        if run is None:
            return 0, known
        first = j - run.first
        most = min(TOGETHER, len(run.on.H) - first)
        error = self._room(most, known, run.split)
        error.whole[0] = out.norm[j]
        flow = FlowArrays(*np.empty((3, len(known.delta))))
        sizes = known.size, known.radius
        count = carry_split(
            run.split.arrays, self._faces, run.on, first, most, False, *sizes, False, flow, error
        )
        if not count:
            return 0, known
        to = slice(j + 1, j + 1 + count)
        out.delta[to] = error.delta[1 : count + 1]
        out.radius[to] = np.linalg.norm(error.radii[1 : count + 1], axis=1)
        out.norm[to] = error.whole[1 : count + 1]
        out.pulled[to] = out.pulled[j] + np.cumsum(error.pulled[:count], axis=0)
        out.unknown[to] = out.unknown[j] + np.cumsum(error.unknown[:count])
        return count, Known(error.delta[count], run.split, error.radii[count])

    @staticmethod
    def _room(most: int, known: Known, split: Split) -> ErrorArrays:
        """Return arrays for the error over so many stretches, with what is known at their head."""
        n = len(known.delta)
        error = ErrorArrays(
            delta=np.empty((most + 1, n)),
            radii=np.empty((most + 1, len(split.parts))),
            whole=np.empty(most + 1),
            pulled=np.empty((most, n)),
            unknown=np.empty(most),
            is_reached=np.zeros(len(split.arrays.is_in), bool),
        )
        error.delta[0] = known.delta
        error.radii[0] = known.radii_in(split)
        error.whole[0] = 0.0
        return error

    def _to_next(self, j: int, known: Known, out: Carried) -> Known:
        """Carry what is known at node j to the next one; return what is known there."""
        new, pulled, unknown = self._over_interval(j, known)
        out.pulled[j + 1] = out.pulled[j] + pulled
        out.unknown[j + 1] = out.unknown[j] + unknown
        # the norm alone can be the better bound: then nothing is known of the direction
        norm = self._growth[j] * out.norm[j] + self._added[j]
        out.norm[j + 1] = min(norm, new.size)
        if norm < new.radius:
            new = Known(np.zeros_like(new.delta), self.split((), j), np.array([norm]))
        out.delta[j + 1] = new.delta
        out.radius[j + 1] = new.radius
        return new

    def _over_interval(self, j: int, known: Known) -> tuple[Known, np.ndarray, float]:
        """Return what is known of the error at the end of interval j, the integral (n,) over it of
        what the drift at Y differs from that at x, and a bound of what that lacks."""
        new = known
        pulled = np.zeros_like(known.delta)
        unknown = 0.0
        for stretch in self.path.stretches[j]:
            new, more_pulled, more_unknown = self._carried(j, stretch, new)
            pulled += more_pulled
            unknown += more_unknown
        if not len(stretch.residual):  # a local solution, from which Y jumps
            new = replace(new, delta=new.delta + self.path.push[j])
        widened = new.radius - max(1.0, self._growth[j]) * known.radius
        if new.radius > max(UNKNOWN * new.size, LEAST) and widened > WIDENED * new.size:
            second = self._by_second_solution(j, known)
            if second is not None and second[0].radius < new.radius:
                return second
        return new, pulled, unknown

    def _by_second_solution(self, j: int, known: Known) -> tuple[Known, np.ndarray, float] | None:
        """Return the same, by the local solution X from where x is known to be near; None if it
        does not get to the end of the interval, leaves the tube in which the drift has its
        constants, or no such state of S is found.

        The distance of X and x grows as that of any two curves in S: where contacts close and open
        in another order along x than along Y, Y - X is still known as a vector.
        """
        path = self.path
        shadow = path.shadow
        t = float(path.nodes.t[j])
        H = float(path.H[j])
        near = path.Y[j] - known.delta
        start = shadow.feasible(np.array([t]), near[None], ())[0]
        if not shadow.holds(np.array([t]), start[None]):
            return None
        found = local_solution(shadow, t, H, start, path.Y[j + 1])
        drift = self.drift.at(j)
        states = np.concatenate([s.states for s in found.pieces])
        if not (found.is_complete and drift.holds_at(states)):
            return None
        factor = np.exp(drift.one_sided * H)
        apart = known.radius + size(start - near)
        radius = factor * apart + max(1.0, factor) * found.residual
        most = max(1.0, factor) * (apart + found.residual)
        new = Known(path.Y[j + 1] - found.state, self.split((), j), np.array([radius]))
        unknown = found.doubt + drift.two_sided * H * most
        return new, path.along[j] - found.drift, unknown

    def _carried(self, j: int, at: Stretch, known: Known) -> tuple[Known, np.ndarray, float]:
        """Return what is known of the error at the end of a stretch of interval j, the integral
        (n,) of J w over it, and a bound of what that lacks."""
        contacts = set(self._places(at))
        # the contacts that act are those of Y, and whatever x may reach while only these act
        while True:
            split = self.split(tuple(sorted(contacts)), j)
            error = self._over_stretch(at, known, split)
            more = set(np.flatnonzero(error.is_reached).tolist())
            if more <= contacts:
                end = Known(error.delta[1], split, error.radii[1])
                return end, error.pulled[0], float(error.unknown[0])
            contacts |= more

    def _over_stretch(self, at: Stretch, known: Known, split: Split) -> ErrorArrays:
        """Return the error over one stretch, if no contacts but those of the split act on x or
        Y."""
        error = self._room(1, known, split)
        flow = FlowArrays(*np.empty((3, len(known.delta))))
        is_given = at.H * split.speed > LONG
        if is_given:
            start = split.tangent @ known.delta
            flow.end[:], flow.integral[:] = long_flow(split.along, at.H, start)
        on = self._arrays([at], split, np.ones(1), np.zeros(1))
        sizes = known.size, known.radius
        carry_split(split.arrays, self._faces, on, 0, 1, True, *sizes, is_given, flow, error)
        return error

    def _least_gaps(self, stretches: list[Stretch]) -> np.ndarray:
        """Return (K, m) lower bounds of all gaps along K stretches."""
        parts = np.arange(4) / 3.0
        times = np.concatenate([s.t + parts * s.H for s in stretches])
        gaps = self.rows.gaps(times, np.concatenate([s.states for s in stretches]))
        gaps = gaps.reshape(len(stretches), 4, -1)
        # a cubic is in the hull of its control points, up to its shift onto faces; walls that move
        # are bent besides, which shows at a state that rests
        off = np.array([s.slack for s in stretches])[:, None]
        if self.rows.is_moving:
            resting = np.repeat([s.states[0] for s in stretches], 4, axis=0)
            walls = self.rows.gaps(times, resting).reshape(gaps.shape)
            off = off + 0.5 * np.abs(np.diff(walls, n=2, axis=1)).max(axis=1)
        return gaps.min(axis=1) - off

    def pulls(self, loads: np.ndarray, ids: tuple, split: Split) -> np.ndarray:
        """Return (K, parts, 4) kappa of each part in the quarters of K stretches, on which the
        contacts `ids` act with multipliers loads (K, 5, m): 0.0 unless all of its contacts are
        closed with positive ones."""
        quarters = np.minimum(loads[:, :-1], loads[:, 1:])
        column = {self.place[c]: a for a, c in enumerate(ids)}
        pulls = np.zeros((len(loads), len(split.parts), quarters.shape[1]))
        for k, part in enumerate(split.parts):
            q = [column.get(split.contacts[a], -1) for a in split.groups[k]]
            if part.is_independent and -1 not in q:
                pulls[:, k] = np.maximum((quarters[:, :, q] / part.reach).min(axis=2), 0.0)
        return pulls


def long_flow(A: np.ndarray, H: float, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return exp(H A) v and the integral of exp(s A) v over 0 <= s <= H, (n,) each, by scaling and
    squaring of a matrix that holds both."""
    from scipy.linalg import expm

    both = np.zeros((len(v) + 1, len(v) + 1))
    both[:-1, :-1] = H * A
    both[:-1, -1] = H * v
    both = expm(both)
    return both[:-1, :-1] @ v, both[:-1, -1]
