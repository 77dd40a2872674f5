"""All families of one problem at a state: candidates, gaps, gradients as sparse rows, rates.

Listed constraints (affine rows, fixed pairs, anchors, smooth ones) are always candidates; of the
pairs of hard particles only those near each other, which cell lists determine. The order is the one
stated by the problem: family, then i, then j.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence

import numpy as np

from nsbench.compilation.factories import as_numpy
from nsbench.dynamics.contacts.candidates import (
    ANCHOR,
    PAIR,
    ROW,
    SMOOTH,
    CandidateContacts,
    ContactLayout,
    join,
    make_candidates,
    pairs_brute_force,
)
from nsbench.dynamics.contacts.time_dependence import (
    SmoothRows,
    concatenate_curves,
    time_derivative,
)
from nsbench.problem import Affine, Complementarity, Distance, Smooth

FEW = 64  # hard particles: all their pairs are looked at sooner than a kernel is compiled


def _stacked(families: list[Affine]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Stack all affine rows as CSR: ptr, cols, vals.

    The arrays of a single family are not copied: a large scene has many rows.
    """
    if len(families) == 1:
        return families[0].indptr, families[0].indices, families[0].data
    ptr = [np.zeros(1, np.int64)]
    cols = [np.empty(0, np.int64)]
    vals = [np.empty(0)]
    for a in families:
        ptr.append(a.indptr[1:] + ptr[-1][-1])
        cols.append(a.indices)
        vals.append(a.data)
    return np.concatenate(ptr), np.concatenate(cols), np.concatenate(vals)


class ConstraintSet:
    """Evaluate the constraints of a Complementarity problem with a state of size n.

    Attributes used by kernels: ptr, cols, vals, inv2 (all affine rows as CSR), and b(t), anchors(t)
    as flat arrays.
    """

    def __init__(self, problem: Complementarity, n: int):
        self.families = problem.constraints
        self.n = n
        self.affine = [c for c in self.families if isinstance(c, Affine)]
        self.anchored = [
            c for c in self.families if isinstance(c, Distance) and c.anchors is not None
        ]
        self.moving = any(c.moving for c in self.families)
        self.ptr, self.cols, self.vals = _stacked(self.affine)
        rows = len(self.ptr) - 1
        self.inv2 = 1.0 / np.add.reduceat(self.vals**2, self.ptr[:-1]) if rows else np.empty(0)
        self._b = [as_numpy(a.b) if a.moving else (lambda t, v=a.b: v) for a in self.affine]
        self._anchors = [
            as_numpy(c.anchors) if c.moving else (lambda t, v=c.anchors: v) for c in self.anchored
        ]
        self.b_factory = concatenate_curves([a.b for a in self.affine])
        self.anchor_factory = concatenate_curves([c.anchors for c in self.anchored])
        self._smooth = [SmoothRows(c, n) for c in self.families if isinstance(c, Smooth)]
        if any(isinstance(c, Distance) and not c.all_pairs for c in self.families):
            _ = self._parts  # bad indices are told at once
        self.hard = [
            (k, c, c.particles(n))
            for k, c in enumerate(self.families)
            if isinstance(c, Distance) and c.all_pairs
        ]
        self.radii = {
            k: np.broadcast_to(c.radii if c.radii is not None else c.d / 2, m).astype(float)
            for k, c, m in self.hard
        }

    @functools.cached_property
    def row_lengths(self) -> np.ndarray:
        """Return (rows,) the lengths of the gradients of all affine rows."""
        from scipy.sparse import csr_array

        # a column that is listed twice counts once, with the sum
        rows = csr_array((self.vals, self.cols, self.ptr), shape=(len(self.inv2), self.n)).copy()
        rows.sum_duplicates()
        return np.sqrt(np.asarray(rows.multiply(rows).sum(axis=1), float).ravel())

    def b(self, t: float) -> np.ndarray:
        """Return (rows,) the right-hand sides of all affine rows at time t."""
        return (
            np.concatenate([np.asarray(f(t), float) for f in self._b]) if self._b else np.empty(0)
        )

    def anchors(self, t: float) -> np.ndarray:
        """Return the coordinates of all anchors at time t, flat, (a,)."""
        return np.concatenate(
            [np.empty(0), *(np.asarray(f(t), float).ravel() for f in self._anchors)]
        )

    def smooth(self, s: int) -> SmoothRows:
        """Return the s-th Smooth family: g(t, x), gradient(t, x), rate(t, x) in numpy."""
        return self._smooth[s]

    @functools.cached_property
    def _parts(self) -> dict[int, CandidateContacts]:
        """Return the listed constraints by family, built when first needed.

        Rows take 72 bytes each.
        """
        parts = {}
        row = 0
        anchor = 0
        smooth = 0
        for k, c in enumerate(self.families):
            if isinstance(c, Affine):
                m = c.shape[0]
                i = np.arange(m)
                parts[k] = make_candidates(
                    ROW, k, i, np.full(m, -1), row + i, np.zeros(m), 0.0, 1, 1
                )
                row += m
            elif isinstance(c, Smooth):
                m = self._smooth[smooth].m
                i = np.arange(m)
                parts[k] = make_candidates(
                    SMOOTH, k, i, np.full(m, -1), i, np.full(m, smooth), 0.0, 1, 1
                )
                smooth += 1
            elif not c.all_pairs:
                parts[k] = self._listed(k, c, anchor)
                anchor += (
                    0
                    if c.anchors is None
                    else np.asarray(as_numpy(c.anchors)(0.0) if c.moving else c.anchors).size
                )
        return parts

    def _listed(self, k: int, c: Distance, anchor: int) -> CandidateContacts:
        """Return the candidates of a distance family with fixed pairs or anchors."""
        count = c.particles(self.n)
        pairs = c.pairs
        targets = count
        if c.anchors is not None:
            targets = len(np.asarray(as_numpy(c.anchors)(0.0) if c.moving else c.anchors))
            if pairs is None:
                pairs = np.stack(
                    np.meshgrid(np.arange(count), np.arange(targets), indexing="ij"), -1
                ).reshape(-1, 2)
        if len(pairs) and (pairs[:, 0].max() >= count or pairs[:, 1].max() >= targets):
            raise ValueError(
                f"family {k}: a pair names particle or anchor {pairs.max()}; "
                f"there are {count} and {targets}"
            )
        i, j = pairs.T
        q = anchor + j * c.dim if c.anchors is not None else c.start + j * c.dim
        return make_candidates(
            PAIR if c.anchors is None else ANCHOR,
            k,
            i,
            j,
            c.start + i * c.dim,
            q,
            c.d,
            c.sign,
            c.dim,
        )

    def all_static(self) -> CandidateContacts:
        """Return the listed constraints alone, without pairs of hard particles."""
        return join([self._parts[k] for k in sorted(self._parts)])

    def near(self, x: np.ndarray, reach: float, t: float = 0.0) -> CandidateContacts:
        """Return every listed constraint and the hard pairs with gap at most `reach` (inf: all).

        In the order of the problem. x (n,) must be finite.
        """
        parts = dict(self._parts)
        for k, c, m in self.hard:
            r = self.radii[k]
            if m <= FEW or reach == np.inf:
                i, j = pairs_brute_force(
                    np.asarray(x, float)[c.start : c.start + m * c.dim].reshape(m, c.dim),
                    r,
                    float(reach),
                )
            else:
                from nsbench.dynamics.contacts.kernels.cell_list import near_pairs

                i, j = near_pairs(np.ascontiguousarray(x), c.start, m, c.dim, r, float(reach))
            parts[k] = make_candidates(
                PAIR, k, i, j, c.start + i * c.dim, c.start + j * c.dim, r[i] + r[j], 1, c.dim
            )
        return join([parts[k] for k in sorted(parts)])

    def max_violation(self, t: float, x: np.ndarray) -> float:
        """Return the largest violation of a constraint at (t, x), 0.0 where there is none.

        That of near(x, 0.0, t), without listing it.
        """
        worst = max(0.0, float(-self.gaps(t, x, *self._static).min(initial=0.0)))
        for k, c, m in self.hard:
            from nsbench.dynamics.contacts.kernels.cell_list import near_pairs

            i, j = (
                near_pairs(np.ascontiguousarray(x), c.start, m, c.dim, self.radii[k], 0.0)
                if m > 1
                else ((), ())
            )
            if len(i):
                p = x[c.start : c.start + m * c.dim].reshape(m, c.dim)
                r = self.radii[k]
                diff = p[i] - p[j]
                worst = max(
                    worst, float(-(np.sqrt((diff * diff).sum(1)) - (r[i] + r[j])).min(initial=0.0))
                )
        return worst

    @functools.cached_property
    def _static(self):
        """Return the listed constraints and their layout."""
        return (near := self.all_static()), self.layout(near)

    @functools.cached_property
    def _static_places(self) -> dict[tuple, int]:
        """Return the places of the listed constraints by id."""
        return {c: k for k, c in enumerate(self._static[0].ids)}

    def layout(self, near: CandidateContacts) -> ContactLayout:
        """Return the positions of the entries of `near` by kind.

        For many evaluations of the same contacts.
        """
        pairs = []
        for kind in (PAIR, ANCHOR):
            of_kind = near.kind == kind
            for dim in (1, 2, 3) if of_kind.any() else ():
                sel = np.flatnonzero(of_kind & (near.dim == dim))
                if sel.size:
                    axes = np.arange(dim)
                    pairs.append((kind, sel, near.p[sel, None] + axes, near.q[sel, None] + axes))
        smooth = [
            np.flatnonzero((near.kind == SMOOTH) & (near.q == s)) for s in range(len(self._smooth))
        ]
        return ContactLayout(tuple(pairs), np.flatnonzero(near.kind == ROW), tuple(smooth))

    def gaps(
        self, t: float, x: np.ndarray, near: CandidateContacts, layout: ContactLayout | None = None
    ) -> np.ndarray:
        """Return (m,) the gaps g_k(t, x) of the candidates `near`."""
        g = np.empty(len(near))
        layout = layout or self.layout(near)
        for sel, _, _, dist in self._distances(t, x, layout):
            g[sel] = near.sign[sel] * (dist - near.d[sel])
        if layout.rows.size:
            prod = np.add.reduceat(self.vals * x[self.cols], self.ptr[:-1])
            g[layout.rows] = (prod + self.b(t))[near.p[layout.rows]]
        for fam, sel in zip(self._smooth, layout.smooth, strict=True):
            if sel.size:
                g[sel] = fam.g(t, x)[near.p[sel]]
        return g

    def _distances(self, t, x, layout):
        """Yield the distances of each kind and dimension.

        Entries, coordinates of i (and j), differences (m, dim), lengths (m,).
        """
        for kind, sel, i, j in layout.pairs:
            diff = x[i] - (x[j] if kind == PAIR else self.anchors(t)[j])
            yield sel, (i, j if kind == PAIR else None), diff, np.sqrt((diff * diff).sum(1))

    def dense_gradients(self, t: float, x: np.ndarray, near: CandidateContacts) -> np.ndarray:
        """Return (m, n) the gradients of the gaps as a dense matrix."""
        G = np.zeros((len(near), self.n))
        r, c, v = self.gradient_entries(t, x, near)
        np.add.at(G, (r, c), v)
        return G

    def gradients(self, t: float, x: np.ndarray, near: CandidateContacts):
        """Return (m, n) the gradients of the gaps as a scipy.sparse.csr_array.

        A distance of zero has the first axis as its direction.
        """
        from scipy.sparse import csr_array

        r, c, v = self.gradient_entries(t, x, near)
        return csr_array((v, (r, c)), shape=(len(near), self.n))

    def gradient_entries(
        self, t: float, x: np.ndarray, near: CandidateContacts
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return rows (e,), columns (e,) and values (e,) of the gradients at x (n,).

        Rows and columns are the same for every t and x.
        """
        layout = self.layout(near)
        r = [np.empty(0, np.int64)]
        c = [np.empty(0, np.int64)]
        for kind, sel, i, j in layout.pairs:
            for coords in (i, j) if kind == PAIR else (i,):
                r.append(np.repeat(sel, coords.shape[1]))
                c.append(coords.ravel())
        for k in layout.rows:
            e = slice(self.ptr[near.p[k]], self.ptr[near.p[k] + 1])
            r.append(np.full(e.stop - e.start, k))
            c.append(self.cols[e])
        for sel in layout.smooth:
            r.append(np.repeat(sel, self.n))
            c.append(np.tile(np.arange(self.n), sel.size))
        return np.concatenate(r), np.concatenate(c), self.gradient_values(t, x, near, layout)

    def gradient_values(
        self, t: float, x: np.ndarray, near: CandidateContacts, layout: ContactLayout
    ) -> np.ndarray:
        """Return the values (e,) of `gradient_entries` alone, at x (n,)."""
        v = [np.empty(0)]
        for sel, (_, j), diff, dist in self._distances(t, x, layout):
            unit = np.divide(diff, dist[:, None], out=np.zeros_like(diff), where=dist[:, None] > 0)
            unit[dist == 0, 0] = 1.0
            unit *= near.sign[sel, None]
            v += [unit.ravel()] if j is None else [unit.ravel(), (-unit).ravel()]
        v += [self.vals[self.ptr[p] : self.ptr[p + 1]] for p in near.p[layout.rows]]
        for fam, sel in zip(self._smooth, layout.smooth, strict=True):
            if sel.size:
                v.append(fam.gradient(t, x)[near.p[sel]].ravel())
        return np.concatenate(v)

    def rates(self, t: float, x: np.ndarray, near: CandidateContacts) -> np.ndarray:
        """Return (m,) the partial derivatives dg/dt."""
        rate = np.zeros(len(near))
        if not self.moving:
            return rate
        rows = np.flatnonzero(near.kind == ROW)
        if rows.size:
            rate[rows] = np.concatenate(
                [time_derivative(a.b)(t) if a.moving else np.zeros(a.shape[0]) for a in self.affine]
            )[near.p[rows]]
        if any(c.moving for c in self.anchored):
            speed = np.concatenate(
                [
                    time_derivative(c.anchors)(t).ravel() if c.moving else np.zeros(c.anchors.size)
                    for c in self.anchored
                ]
            )
            for sel, (_, j), diff, dist in self._distances(t, x, self.layout(near)):
                if j is None:
                    q = near.q[sel, None] + np.arange(diff.shape[1])
                    rate[sel] = (
                        -near.sign[sel] * (diff * speed[q]).sum(1) / np.where(dist > 0, dist, 1.0)
                    )
        for s, fam in enumerate(self._smooth):
            sel = np.flatnonzero((near.kind == SMOOTH) & (near.q == s))
            if sel.size:
                rate[sel] = fam.rate(t, x)[near.p[sel]]
        return rate


def near_of(scene: ConstraintSet, contacts: Sequence[tuple]) -> CandidateContacts:
    """Build the candidates with the given ids, in their order."""
    static, _ = scene._static
    at = scene._static_places
    hard = {k: (c, scene.radii[k]) for k, c, _ in scene.hard}
    rows = []
    for c in contacts:
        if c[0] in hard:
            fam, r = hard[c[0]]
            i = c[1]
            j = c[2]
            rows.append(
                (
                    PAIR,
                    c[0],
                    i,
                    j,
                    fam.start + i * fam.dim,
                    fam.start + j * fam.dim,
                    r[i] + r[j],
                    1.0,
                    fam.dim,
                )
            )
        else:
            k = at[c] if c in at else at[(c[0], c[2], c[1])]
            rows.append(tuple(a[k] for a in static.arrays()))
    like = static.arrays()
    columns = zip(*rows, strict=True) if rows else [()] * len(like)
    return CandidateContacts(*(np.array(v, a.dtype) for v, a in zip(columns, like, strict=True)))
