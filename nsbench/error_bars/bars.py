"""Error bars at every sample: residuals of a comparison curve, and how the errors they cause grow.

What a trajectory needs to have them, and its scaling, is error_bars.entry.

Let Y be a curve in the feasible set S, q >= 0 with q . g(Y) = 0, and rho = Y' - f(t, Y) - N^T q.
For convex S the exact motion x with multipliers Lambda has

    <Y - x, N^T Lambda> = Lambda . (g(Y) - g(x)) >= 0,    <Y - x, N^T q> = -q . g(x) <= 0,

so that (|Y - x|^2)' / 2 <= L |Y - x|^2 + |rho| |Y - x| with the one-sided Lipschitz constant L, and

    |Y - x| (t) <= int exp(L (t - s)) |rho(s)| ds + sum of exp(L (t - t_j)) |jump of Y at t_j|.

How much of Y - x is known by direction, and shrinks in contact: nsbench.error_bars.split_bound.

The error of the run is at most |x_n - Y| more. Y follows the recorded states (nsbench.error_bars.
shadow), and where contacts close or open the local solution (local_solution). The reaction is
R(t) = x(t) - x(0) - int f, hence |R_n - R| <= |x_n - Y - D| + |Y - x| + Lip int |Y - x| ds, with
D = x_n - x_0 - R_n - int f(s, Y(s)) ds.

Where S is not convex, Y - x is carried on by the linearised flow on the face of the active contacts
and the sum of norms is an estimate, no bound. docs/error_bars.md has the proof.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from nsbench.dynamics.contacts.candidates import ROW
from nsbench.dynamics.contacts.constraint_set import ConstraintSet
from nsbench.error_bars.contact_rows import ContactRows, size
from nsbench.error_bars.drift import Drift
from nsbench.error_bars.entry import LINEARISED
from nsbench.error_bars.growth import Linear, Tube, enclosed_drift, linear_drift
from nsbench.error_bars.local_solution import MOST_PIECES, local_solution
from nsbench.error_bars.scene_kernels import SceneKernels
from nsbench.error_bars.shadow import Shadow, Stretch, bezier_middle
from nsbench.error_bars.split_bound import SplitBound

# of the vectors whose sum is an error: they may cancel by more than they are right
CANCELLED = 0.05
ACTS = 1e-12  # of the largest impulse of an interval: less of one is rounding of a QP
DEPENDENT = 1e-12  # singular value of unit gradients below which it is one of rounding
ENTRIES = 2_000_000  # of gradients that are evaluated at once
TUBES = 6  # that are tried, each WIDER times the last one
WIDER = 2.0
BOXES = 64  # of a tube


@dataclass(frozen=True)
class Nodes:
    """Recorded states of a run: times t (K,), x (K, n), impulse (K, m) of `contacts`."""

    t: np.ndarray
    x: np.ndarray
    impulse: np.ndarray
    contacts: tuple


@dataclass(frozen=True)
class Growth:
    """Error bars at the nodes.

    state (K,): of |x_n - x*|. R_n - R* is known (K, n), less what the drift of the run differs from
    that of the curve, times factor, and a rest of at most reaction (K,). vector (K, n): x_n - x*
    itself, of an estimate, of at most the size `unallowed` (K,); of a bound there is none. apart:
    the most that the curve and x* are apart at any time, and is_proven: does the drift have its
    constants there? Both of a bound.
    """

    factor: float

    state: np.ndarray
    reaction: np.ndarray
    known: np.ndarray
    vector: np.ndarray = field(default_factory=lambda: np.empty((0, 0)))
    unallowed: np.ndarray = field(default_factory=lambda: np.empty(0))
    apart: float = np.nan
    is_proven: bool = False


@dataclass(frozen=True)
class Leg:
    """Part of the curve from t over a length H on which the contacts `rows` act with multipliers
    q (m,): x (n,) its middle, end (n,) its end, face: contacts that act on and behind it."""

    t: float
    H: float
    rows: ContactRows
    x: np.ndarray
    q: np.ndarray
    face: ContactRows
    end: np.ndarray

    def carried(self, kernels: SceneKernels, delta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the error delta (n,) at the end, and the integral (n,) of J delta."""
        if not (self.H > 0.0 and size(delta) > 0.0):  # squares of a tiny one underflow
            return delta, np.zeros_like(delta)
        states = np.array([self.x, self.end])
        return kernels.carry_error(self.rows, self.face, self.t, self.H, states, self.q, delta)


class Path:
    """The comparison curve of a run: feasible states at its nodes, arcs and local solutions.

    sets: by interval the contacts that act in it. closed: by node those that act on both sides.
    gives_up: is nothing of use behind an interval with too many events?
    """

    def __init__(
        self, scene: ConstraintSet, drift: Drift, nodes: Nodes, gives_up: bool = False
    ):
        self.gives_up = gives_up
        self.shadow = Shadow(scene, drift)
        self.nodes = nodes
        self.H = np.diff(nodes.t)
        self.sets = _acting(nodes)
        self.closed = _on_both_sides(self.sets)
        self.Y = np.empty_like(nodes.x)
        for ids, at in _groups(self.closed):
            for some in _parts(at, len(ids) * scene.n):
                self.Y[some] = self.shadow.feasible(nodes.t[some], nodes.x[some], ids)
        self.F = self.shadow.fields(nodes.t, self.Y)
        K = len(nodes.t)
        self.size = np.zeros(K - 1)  # of the residual, integrated; of local solutions with the jump
        self.peak = np.full(K - 1, np.inf)  # of the residual of an arc: its largest size
        self.push = np.zeros((K - 1, scene.n))  # the same as vectors, without that of pieces
        self.slack = np.zeros(K - 1)  # residual of the pieces of a local solution
        self.along = np.zeros((K - 1, scene.n))  # integral of the drift
        self.doubt = np.zeros(K - 1)  # of that integral
        self.stretches: dict[int, list[Stretch]] = {}  # by interval
        self.is_complete = True
        self.is_feasible = self.shadow.holds(nodes.t, self.Y)
        self._integrate()

    def _integrate(self):
        smooth = [j for j in range(len(self.H)) if self._is_smooth(j)]
        rest = set(range(len(self.H))) - set(smooth)
        sets = [self.sets[j] for j in smooth]
        for ids, at in _groups(sets):
            for some in _parts(np.array(smooth)[at], len(ids) * self.Y.shape[1]):
                rest |= self._arcs(some, ids)
        for j in sorted(rest):
            self._local(j)

    def _is_smooth(self, j: int) -> bool:
        """Do the same contacts act in interval j and its neighbours?"""
        now = self.sets[j]
        before = self.sets[j - 1] if j else ()
        after = self.sets[min(j + 1, len(self.sets) - 1)]
        return before == now == after

    def _arcs(self, at, ids) -> set[int]:
        """Measure the arcs of the intervals `at`; return those that leave the feasible set."""
        t = self.nodes.t[at]
        H = self.H[at]
        Y = self.Y
        F = self.F
        arcs = self.shadow.arcs(t, H, Y[at], Y[at + 1], F[at], F[at + 1], ids)
        self.size[at] = arcs.sizes(H)
        self.peak[at] = arcs.peaks(H)
        self.push[at] = arcs.vectors(H)
        self.along[at] = arcs.fields(H)
        self.doubt[at] = arcs.doubts(H)
        rows = self.shadow.rows(ids)
        for k, j in enumerate(at):
            place = float(t[k]), float(H[k]), arcs.controls[:, k], Y[j + 1]
            loads = arcs.q[:, k]
            rho = arcs.residual[:, k]
            unseen = float(arcs.unseen[k])
            stretch = Stretch(*place, rows.ids, loads, frozenset(ids), rho, unseen)
            self.stretches[int(j)] = [stretch]
        return {int(j) for j in at[~arcs.inside]}

    def added(self, rates: np.ndarray) -> np.ndarray:
        """Return (K - 1,) bounds of int exp(L (t - s)) |rho(s)| ds over the intervals, L: one-sided
        Lipschitz constants (K - 1,): by the integral of |rho|, or by its peak, of which a stiff
        drift forgets most."""
        by_integral = np.maximum(1.0, np.exp(rates * self.H)) * self.size
        is_forgotten = rates < 0.0
        decay = np.full(len(rates), np.inf)
        np.divide(np.expm1(rates * self.H), rates, out=decay, where=is_forgotten)
        by_peak = self.peak * decay
        return np.where(by_peak < by_integral, by_peak, by_integral)

    def _local(self, j: int):
        t = float(self.nodes.t[j])
        H = float(self.H[j])
        most = 0 if self.gives_up and not self.is_complete else MOST_PIECES
        found = local_solution(self.shadow, t, H, self.Y[j], self.Y[j + 1], most)
        self.is_complete &= found.is_complete
        self.push[j] = self.Y[j + 1] - found.state
        self.slack[j] = found.residual
        self.size[j] = found.residual + np.linalg.norm(self.push[j])
        self.peak[j] = np.inf
        self.along[j] = found.drift
        self.doubt[j] = found.doubt
        self.stretches[j] = found.pieces

    def bound(self) -> Growth:
        """Return the parts of the bound: convex constraints with flat faces.

        It is proven where the Lipschitz constants of the drift hold between the curve and the exact
        motion. A derivative that is the same in a tube twice as wide as the bound is one of A x +
        u(t). Any other is enclosed in tubes from twice the estimated error on, until one is as wide
        as the bound that follows from it.
        """
        drift = linear_drift(self.shadow.drift, self.nodes.t, self.Y)
        found = self._bound(drift)
        tube = self._tube()
        enclosed = enclosed_drift(drift, self.shadow.drift, tube.widened(WIDER * found.apart))
        if enclosed.is_proven and not enclosed.boxes:
            return replace(found, is_proven=True)
        delta = self.estimate().vector - (self.nodes.x - self.Y)
        radius = WIDER * float(np.linalg.norm(delta, axis=1).max() + self.size.max())
        for _ in range(TUBES):
            enclosed = enclosed_drift(drift, self.shadow.drift, tube.widened(radius))
            if not enclosed.is_proven:
                break
            found = self._bound(enclosed)
            if found.apart <= radius:
                return replace(found, is_proven=True)
            radius *= WIDER
        return found

    def _tube(self) -> Tube:
        """Return boxes around the curve, of BOXES parts of the time at most: each holds nodes and
        control points."""
        first = np.unique(np.linspace(0, len(self.H), BOXES + 1).astype(int))[:-1]
        states = [np.concatenate([s.states for s in self.stretches[j]]) for j in range(len(self.H))]
        count = np.cumsum([0, *map(len, states)])
        low, high = (
            of(
                of.reduceat(np.concatenate(states), count[first]),
                of(of.reduceat(self.Y[:-1], first), of.reduceat(self.Y[1:], first)),
            )
            for of in (np.minimum, np.maximum)
        )
        box = np.searchsorted(first, np.arange(len(self.H)), side="right") - 1
        t = np.append(self.nodes.t[first], self.nodes.t[-1])
        return Tube(t, low, high, box)

    def _bound(self, drift: Linear) -> Growth:
        offset = self.nodes.x - self.Y
        apart = np.linalg.norm(offset, axis=1)
        if not self.shadow.is_flat:  # too many constraints to look at all of them
            e = self._norms(drift, apart[0])
            widest = self._widest(e, drift)
            area = np.append(0.0, np.cumsum(self.H * widest))
            reaction = e + drift.two_sided * area + self.doubts()
            return Growth(1.0, apart + e, reaction, offset, apart=float(widest.max()))
        w = SplitBound(self, drift).carried(-offset[0])
        directed = np.linalg.norm(offset + w.delta, axis=1) + w.radius
        known = offset + w.delta - w.pulled
        rest = w.radius + w.unknown + self.doubts()
        widest = float(self._widest(w.norm, drift).max())
        return Growth(1.0, np.minimum(apart + w.norm, directed), rest, known, apart=widest)

    def _widest(self, e: np.ndarray, drift: Linear) -> np.ndarray:
        """Return (K - 1,) bounds of |Y - x| within the intervals from those e (K,) at the nodes."""
        rates = np.array([drift.at(j).one_sided for j in range(len(self.H))])
        return np.maximum(1.0, np.exp(rates * self.H)) * (e[:-1] + self.size)

    def _norms(self, drift: Linear, first: float) -> np.ndarray:
        """Return (K,) bounds of |Y - x| by its size alone."""
        e = np.full(len(self.nodes.t), first)
        rates = np.array([drift.at(j).one_sided for j in range(len(self.H))])
        growth = np.exp(rates * self.H)
        added = self.added(rates)
        for j in range(len(self.H)):
            e[j + 1] = growth[j] * e[j] + added[j]
        return e

    def estimate(self) -> Growth:
        """Return the parts of the estimate: constraints of any kind, errors linearised."""
        kernels = self.shadow.kernels
        delta = np.zeros_like(self.Y)  # Y - x
        delta[0] = self.Y[0] - self.nodes.x[0]
        pulled = np.zeros_like(self.Y)  # integral of J (Y - x)
        slack = np.append(0.0, np.cumsum(self.slack))
        for j in range(len(self.H)):
            new = delta[j]
            pulled[j + 1] = pulled[j]
            for leg in self._legs(j) if np.any(new) else ():
                new, more = leg.carried(kernels, new)
                pulled[j + 1] += more
            delta[j + 1] = new + self.push[j]
        offset = self.nodes.x - self.Y
        norms = [np.linalg.norm(v, axis=1) for v in (offset, delta, pulled)]
        together = np.linalg.norm(offset + delta, axis=1)
        state = LINEARISED * (together + slack) + CANCELLED * (norms[0] + norms[1])
        reaction = LINEARISED * slack + CANCELLED * sum(norms)
        vector = offset + delta
        return Growth(LINEARISED, state, reaction, vector - pulled, vector, together + slack)

    def _legs(self, j: int) -> list[Leg]:
        """Return the parts of interval j on each of which the same contacts act.

        Contacts that act on two parts that follow one another take off what errors have along
        their normals in between; at the end those that act in the next interval as well.
        """
        parts = self.stretches[j]
        faces = [_common(a.ids, b.ids) for a, b in pairwise(parts)]
        faces.append(self.closed[j + 1])
        ends = [*(s.end for s in parts[:-1]), self.Y[j + 1]]
        rows = self.shadow.rows
        return [
            Leg(s.t, s.H, rows(s.ids), bezier_middle(s.states), s.loads[2], rows(face), end)
            for s, face, end in zip(parts, faces, ends, strict=True)
        ]

    def has_passed(self) -> bool:
        """Are particles on a line in another order somewhere than at the start?

        Then S, which is convex for one order, is not convex where the run has been.
        """
        if not self.shadow.is_flat:
            return False
        rows = self.shadow.all_rows()
        apart = (rows.near.kind != ROW) & (rows.near.dim == 1) & (rows.near.sign > 0)
        if not apart.any():
            return False
        t = self.nodes.t
        first = rows.gradients(t[:1], self.nodes.x[:1])
        along = np.where(np.arange(first.values.shape[2]) < first.count[:, None], first.values, 0.0)
        # on a line a gradient has one direction, and turns where its ends change places
        products = [
            (rows.gradients(t, X).values * along)[:, apart].sum(axis=2)
            for X in (self.nodes.x, self.Y)
        ]
        return any(bool(np.any(p < 0.0)) for p in products)

    def least_singular_values(self) -> np.ndarray:
        """Return (K,) the least singular values of the unit gradients of the contacts that acted
        up to each node, of those that act together: infinite as long as none did, 0.0 where they
        are dependent."""
        least = np.inf
        known: dict[tuple, float] = {}
        values = [least]
        for j, ids in enumerate(self.sets):
            if ids and ids not in known:
                rows = self.shadow.rows(ids)
                at = slice(j + 1, j + 2)
                N = rows.gradients(self.nodes.t[at], self.Y[at]).dense()[0]
                full = rows.m <= N.shape[1]
                value = float(np.linalg.svd(N, compute_uv=False)[-1]) if full else 0.0
                known[ids] = value if value > DEPENDENT else 0.0
            least = min(least, known.get(ids, np.inf))
            values.append(least)
        return np.array(values)

    def multiplier_variation(self) -> float:
        """Return the sum over contacts and intervals of the changes of the mean multipliers."""
        means = np.diff(self.nodes.impulse, axis=0) / self.H[:, None]
        return float(np.abs(np.diff(means, axis=0)).sum())

    def doubts(self) -> np.ndarray:
        """Return (K,) the doubt of curve_drift at each node."""
        return np.append(0.0, np.cumsum(self.doubt))

    def curve_drift(self) -> np.ndarray:
        """Return (K, n) the integral of the drift along the curve up to each node."""
        return np.vstack([np.zeros(self.Y.shape[1]), np.cumsum(self.along, axis=0)])


def _acting(nodes: Nodes) -> list[tuple]:
    """Return by interval the ids of the contacts whose impulse grows in it."""
    gained = np.diff(nodes.impulse, axis=0)
    large = ACTS * gained.max(axis=1, initial=0.0, keepdims=True)
    acts = gained > np.maximum(large, 0.0)
    return [tuple(nodes.contacts[c] for c in np.flatnonzero(row)) for row in acts]


def _on_both_sides(sets: list[tuple]) -> list[tuple]:
    """Return by node the contacts that act before and behind it; at the end, those before it."""
    return [(), *(_common(a, b) for a, b in pairwise(sets)), sets[-1]]


def _common(first: tuple, second: tuple) -> tuple:
    """Return the contacts of the first that are in the second too."""
    held = set(second)
    return tuple(c for c in first if c in held)


def _groups(sets: list[tuple]) -> list[tuple[tuple, np.ndarray]]:
    """Return the distinct sets, each with the places at which it stands."""
    places: dict[tuple, list[int]] = {}
    for k, s in enumerate(sets):
        places.setdefault(s, []).append(k)
    return [(s, np.array(at)) for s, at in places.items()]


def _parts(at: np.ndarray, entries: int) -> list[np.ndarray]:
    """Cut the places into parts with at most ENTRIES gradient entries each."""
    return np.array_split(at, max(1, -(-len(at) * max(1, entries) // ENTRIES)))

