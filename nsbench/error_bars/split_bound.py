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

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from nsbench.error_bars.contact_rows import ContactRows, size
from nsbench.error_bars.growth import Linear
from nsbench.error_bars.kernels.local_piece import OUTSIDE
from nsbench.error_bars.kernels.split_step import FlowArrays, SplitArrays, carry_split
from nsbench.error_bars.local_solution import local_solution
from nsbench.error_bars.shadow import Stretch
from nsbench.error_bars.unit_gradients import for_kernel

RANK = 1e-9  # relative singular value below which rows count as dependent
# of the error: a second solution is worth it where more than UNKNOWN of it has no known direction,
# and WIDENED of it is new
UNKNOWN = 0.02
WIDENED = 1e-3
LONG = 8.0  # of the exponent of a flow: by scaling and squaring, no longer by its series
LEAST = OUTSIDE  # of own length: not even the states of S are known any better


class Part:
    """A subspace of errors: projection (n, n), and how the drift acts on it.

    rate: one-sided Lipschitz constant in it. inflow: norm of the drift's derivative into it from
    the rest. N (m, n): unit gradients of the group whose span it is, (0, n) of the tangential part.
    """

    def __init__(self, basis: np.ndarray, N: np.ndarray, drift: Linear):
        n = len(drift.J)
        self.projection = basis @ basis.T
        rest = np.eye(n) - self.projection
        self.is_empty = basis.shape[1] == 0
        self.rate = _largest(basis.T @ (0.5 * (drift.J + drift.J.T)) @ basis) + drift.change
        self.inflow = _norm(self.projection @ drift.J @ rest)
        self.is_independent = 0 < len(N) == basis.shape[1]
        self.reach = np.linalg.norm(np.linalg.pinv(N, rcond=RANK), axis=0) if len(N) else None


class Split:
    """Subspaces of the errors: tangential to the contacts, and the spans of their groups. Raises
    ArithmeticError for a drift whose derivative is not finite.

    contacts: places of the contacts; N (m, n): their unit gradients. groups: by part the positions
    of its contacts among `contacts`, of the tangential part, the first one, none.
    """

    def __init__(self, contacts: tuple, N: np.ndarray, drift: Linear):
        if not np.all(np.isfinite(drift.J)):
            raise ArithmeticError("the derivative of the drift is not finite")
        self.contacts = contacts
        self.drift = drift
        self.groups = [np.empty(0, int), *_coupled(N)]
        n = len(drift.J)
        bases = [_span(N[g]) for g in self.groups[1:]]
        whole = np.hstack([np.zeros((n, 0)), *bases])
        tangent = np.linalg.svd(whole)[0][:, whole.shape[1] :] if whole.size else np.eye(n)
        self.parts = [
            Part(basis, N[g], drift)
            for basis, g in zip([tangent, *bases], self.groups, strict=True)
        ]
        self.tangent = self.parts[0].projection
        self.sizes: np.ndarray | None = None  # (parts, m) of all unit gradients in the parts
        self._norms_in: dict[tuple, np.ndarray] = {}
        self.along = self.tangent @ drift.J @ self.tangent
        self.speed = float(np.linalg.norm(self.along))
        of_parts = [(p.is_empty, p.rate, p.inflow) for p in self.parts]
        is_empty, rates, inflows = (np.array(v) for v in zip(*of_parts, strict=True))
        ptr = np.cumsum([0, *(b.shape[1] for b in bases)])
        own = for_kernel(whole.T), ptr, is_empty, for_kernel(self.along), self.speed
        self.arrays = SplitArrays(
            *own, rates, inflows, float(drift.change), float(drift.one_sided)
        )

    def norms_in(self, other: Split) -> np.ndarray:
        """Return the norms of the products of projections on the parts of another split (rows) and
        on those of this one (columns)."""
        if other.contacts not in self._norms_in:
            rows = [[_norm(p.projection @ q.projection) for q in self.parts] for p in other.parts]
            self._norms_in[other.contacts] = np.array(rows)
        return self._norms_in[other.contacts]


def _coupled(N: np.ndarray) -> list[np.ndarray]:
    """Return groups of rows (m, n) such that rows of different groups are orthogonal."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    if not len(N):
        return []
    count, label = connected_components(csr_array(np.abs(N @ N.T) > RANK))
    return [np.flatnonzero(label == g) for g in range(count)]


def _span(N: np.ndarray) -> np.ndarray:
    """Return an orthonormal basis (n, rank) of the span of rows N (m, n)."""
    _, s, V = np.linalg.svd(N, full_matrices=False)
    return V[s > RANK * s[0]].T


def _largest(A: np.ndarray) -> float:
    return float(np.linalg.eigvalsh(A)[-1]) if A.size else 0.0


def _norm(A: np.ndarray) -> float:
    return float(np.linalg.norm(A, 2)) if A.size else 0.0


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


class SplitBound:
    """The bound at the nodes of a path (nsbench.error_bars.bars.Path) over a polyhedron.

    rows: all constraints; split: by set of contacts.
    """

    def __init__(self, path, drift: Linear):
        self.path = path
        self.drift = drift
        self.rows: ContactRows = path.shadow.all_rows()
        self.place = {c: k for k, c in enumerate(self.rows.ids)}
        self.N = self.rows.constant_gradients(path.nodes.t[0], path.Y[0])
        stretches = [s for j in range(len(path.H)) for s in path.stretches[j]]
        gaps = self._least_gaps(stretches)
        self._gaps = {id(s): g for s, g in zip(stretches, gaps, strict=True)}
        self._splits: dict[tuple, Split] = {}

    def split(self, contacts: tuple, j: int) -> Split:
        """Return the subspaces of contacts, by their places among all rows, in interval j."""
        drift = self.drift.at(j)
        key = contacts, id(drift)
        if key not in self._splits:
            self._splits[key] = Split(contacts, self.N[list(contacts)], drift)
        return self._splits[key]

    def carried(self, start: np.ndarray) -> Carried:
        """Carry the error start (n,) of the curve to all nodes."""
        K = len(self.path.nodes.t)
        out = Carried(*(np.zeros((K, len(start))) for _ in range(2)), *np.zeros((3, K)))
        known = Known(start, self.split((), 0), np.zeros(1))
        out.delta[0] = start
        out.norm[0] = np.linalg.norm(start)
        for j in range(len(self.path.H)):
            new, pulled, unknown = self._over_interval(j, known)
            out.pulled[j + 1] = out.pulled[j] + pulled
            out.unknown[j + 1] = out.unknown[j] + unknown
            # the norm alone can be the better bound: then nothing is known of the direction
            norm = self._norm_bound(j, out.norm[j])
            out.norm[j + 1] = min(norm, new.size)
            known = new
            if norm < new.radius:
                known = Known(np.zeros_like(start), self.split((), j), np.array([norm]))
            out.delta[j + 1] = known.delta
            out.radius[j + 1] = known.radius
        return out

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
        grown = max(1.0, np.exp(self.drift.at(j).one_sided * self.path.H[j]))
        widened = new.radius - grown * known.radius
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

    def _norm_bound(self, j, e) -> float:
        one_sided = self.drift.at(j).one_sided
        return np.exp(one_sided * self.path.H[j]) * e + self.path.added(j, one_sided)

    def _carried(self, j: int, at: Stretch, known: Known) -> tuple[Known, np.ndarray, float]:
        """Return what is known of the error at the end of a stretch of interval j, the integral
        (n,) of J w over it, and a bound of what that lacks."""
        contacts = {self.place[c] for c in at.closed}
        # the contacts that act are those of Y, and whatever x may reach while only these act
        while True:
            step = _Step(self, at, known, self.split(tuple(sorted(contacts)), j))
            more = set(np.flatnonzero(self._gaps[id(at)] <= step.reaches(self.N)).tolist())
            if more <= contacts:
                return step.end, self.drift.at(j).J @ step.flow.integral, step.unknown
            contacts |= more

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

    def pulls(self, at: Stretch, split: Split) -> np.ndarray:
        """Return (parts, 4) kappa of each part in the quarters of a stretch: 0.0 unless all of its
        contacts are closed with positive multipliers."""
        quarters = np.minimum(at.loads[:-1], at.loads[1:])
        loads = {self.place[c]: quarters[:, a] for a, c in enumerate(at.ids)}
        none = np.zeros(len(quarters))
        pulls = np.zeros((len(split.parts), len(quarters)))
        for k, part in enumerate(split.parts):
            if part.is_independent and loads:
                q = np.array([loads.get(split.contacts[a], none) for a in split.groups[k]])
                pulls[k] = np.maximum((q / part.reach[:, None]).min(axis=0), 0.0)
        return pulls


class _Step:
    """The error over one stretch, if no contacts but those of the split act on x or Y.

    end: what is known at its end; peaks: largest sizes of z in the parts of the split on the way;
    flow: the known part, bend: how far it may be from the line between its ends; unknown: bound of
    what J times its integral lacks of the integral of J w.
    """

    def __init__(self, bound: SplitBound, at: Stretch, known: Known, s: Split):
        n = len(known.delta)
        H = at.H
        self.split = s
        self.two_sided = bound.rows.near.sign < 0
        self.peaks = np.zeros(len(s.parts))
        self.flow = FlowArrays(np.empty(n), np.empty(n), np.empty(n))
        radii = for_kernel(known.radii_in(s).copy())
        is_given = H * s.speed > LONG
        if is_given:
            self.flow.end[:], self.flow.integral[:] = long_flow(s.along, H, s.tangent @ known.delta)
        residual = for_kernel(at.residual)
        error = for_kernel(known.delta), known.size, residual, at.slack, H, bound.pulls(at, s)
        out = carry_split(s.arrays, *error, is_given, self.flow, radii, self.peaks)
        self.bend, lack, most = out
        self.end = Known(self.flow.end, s, radii)
        self.unknown = s.drift.two_sided * (size(self.peaks) * H + lack)
        self.unknown += H * s.drift.change * most

    def reaches(self, N: np.ndarray) -> np.ndarray:
        """Return (m,) upper bounds of N w on the stretch, for unit gradients N (m, n)."""
        if self.split.sizes is None:
            parts = [np.linalg.norm(N @ p.projection, axis=1) for p in self.split.parts]
            self.split.sizes = np.array(parts)
        ends = np.maximum(N @ self.flow.start, N @ self.flow.end)
        # a link in one dimension has two ends, on either of which x may be
        other = np.maximum(-(N @ self.flow.start), -(N @ self.flow.end))
        ends = np.where(self.two_sided, np.maximum(ends, other), ends)
        return ends + self.bend + self.peaks @ self.split.sizes


def long_flow(A: np.ndarray, H: float, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return exp(H A) v and the integral of exp(s A) v over 0 <= s <= H, (n,) each, by scaling and
    squaring of a matrix that holds both."""
    from scipy.linalg import expm

    both = np.zeros((len(v) + 1, len(v) + 1))
    both[:-1, :-1] = H * A
    both[:-1, -1] = H * v
    both = expm(both)
    return both[:-1, :-1] @ v, both[:-1, -1]
