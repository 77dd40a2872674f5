"""Penalty over near pairs: integrate in segments, with the pairs listed anew before each.

A segment ends where a particle has travelled further than the lists allow.

The lists of a segment hold every pair with a gap of at most `margin` at its start. While no
coordinate has changed by more than margin / (2 sqrt(dim)), no other pair can touch: its force is
zero, as it would be if it were listed. The program sees to that itself: a right-hand side asked for
beyond is NaN and its step refused (see _diffrax.integrator).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nsbench.case import Case
from nsbench.dynamics.contacts.constraint_set import ConstraintSet
from nsbench.solvers.penalty.limits import Limits
from nsbench.solvers.penalty.program import compiled

# capacities are multiples of it, so that few programs are compiled: discs of one size have 6 or 7
ROOM = 8


@dataclass
class _Totals:
    """Impulses so far of the pairs of one family, by key i N + j: sorted keys and values."""

    N: int
    keys: np.ndarray
    values: np.ndarray

    def of(self, keys: np.ndarray) -> np.ndarray:
        """Return the values (k,) of keys (k,), 0 for pairs never met."""
        at = np.minimum(np.searchsorted(self.keys, keys), max(0, len(self.keys) - 1))
        return (
            np.where(self.keys[at] == keys, self.values[at], 0.0)
            if len(self.keys)
            else np.zeros(len(keys))
        )

    def put(self, keys: np.ndarray, values: np.ndarray) -> None:
        """Take over the values (k,) of `keys` (k,); the others stay."""
        old = ~np.isin(self.keys, keys)
        self.keys = np.concatenate([self.keys[old], keys])
        self.values = np.concatenate([self.values[old], values])
        order = np.argsort(self.keys)
        self.keys = self.keys[order]
        self.values = self.values[order]


class NeighborSegments:
    """Runs of one case with one method, bound to its programs."""

    def __init__(self, case: Case, x0: np.ndarray, method: str, reach: float):
        self.case = case
        self.x0 = x0
        self.method = method
        self.scene = ConstraintSet(case.problem, case.n)
        hard = self.scene.hard
        self.margin = reach * float(
            np.mean(np.concatenate([self.scene.radii[k] for k, _, _ in hard]))
        )
        # rounding of positions and gaps is far below a thousandth of the margin
        self.travel = 0.999 * self.margin / (2.0 * np.sqrt(max(c.dim for _, c, _ in hard)))
        self.capacity = (0,) * len(hard)
        self._lists(x0)
        self._program()

    def _program(self):
        return compiled(
            self.case.problem, self.case.n, len(self.case.t), self.method, "near", self.capacity
        )

    def _lists(self, x):
        """Neighbour tables (N, capacity) of the hard families at x; capacities grow where
        needed."""
        from nsbench.dynamics.contacts.kernels.cell_list import near_pairs

        pairs = [
            near_pairs(np.ascontiguousarray(x), c.start, N, c.dim, self.scene.radii[k], self.margin)
            if N > 1
            else (np.empty(0, np.int64),) * 2
            for k, c, N in self.scene.hard
        ]
        most = [int(np.bincount(np.concatenate(p), minlength=1).max()) for p in pairs]
        self.capacity = tuple(
            max(c, ROOM * -(-max(m, 1) // ROOM)) for c, m in zip(self.capacity, most, strict=True)
        )
        return tuple(
            _table(*p, N, c)
            for p, (_, _, N), c in zip(pairs, self.scene.hard, self.capacity, strict=True)
        )

    def run(self, k: float, limits: Limits) -> dict:
        """Return samples and counts of one run, in the form of the integrator."""
        n = self.case.n
        t = self.case.t
        totals = [_Totals(N, np.empty(0, np.int64), np.empty(0)) for _, _, N in self.scene.hard]
        z = self.x0
        listed = None
        force = np.zeros(n)
        out = {"i": 1, "t": t[0], "h": limits.first_step(self.case, k)}
        out |= {"accepted": 0, "refused": 0, "longest": 0.0}
        X = np.full((len(t), n), np.nan)
        R = X.copy()
        X[0] = z
        R[0] = force
        pieces = []
        while True:  # one segment: neighbour tables of a state, valid for a certified travel
            tables = self._lists(z[:n])
            program = self._program()
            listed = np.zeros(len(program.columns)) if listed is None else listed
            before = out
            out = program(
                np.concatenate([z[:n], _quadratures(program, listed, force, totals, tables)]),
                out["i"],
                out["t"],
                out["h"],
                t,
                k,
                limits.rtol,
                limits.absolute(program.size),
                limits.steps - out["accepted"] - out["refused"],
                (tables, z[:n], self.travel),
            )
            rows = slice(int(before["i"]), int(out["i"]))
            samples = out.pop("samples")
            z = out["z"]
            X[rows] = samples[rows, :n]
            R[rows] = samples[rows, -n:]
            pairs = _pair_impulses(program, n, z, samples[rows], totals, tables)
            columns = samples[rows][:, n + program.columns]
            pieces.append({"rows": rows, "listed": columns, "pairs": pairs})
            listed = z[n + program.columns]
            force = z[-n:]
            for name in ("accepted", "refused"):
                out[name] = int(out[name]) + before[name]
            out["longest"] = max(float(out["longest"]), before["longest"])
            if not out["far"]:
                break
        ids, impulse = self._impulses(program.ids, pieces, totals)
        return out | {
            "x": X,
            "impulse": impulse,
            "reaction": R,
            "ids": ids,
            "segments": len(pieces),
        }

    def _impulses(self, listed, pieces, totals):
        """Contact ids in the stated order and (K, m) impulses: of the listed constraints and of all
        pairs ever met that pushed; NaN where no sample was reached."""
        K = len(self.case.t)
        names = list(listed)
        columns = [np.full((K, len(listed)), np.nan)]
        columns[0][0] = 0.0
        for p in pieces:
            columns[0][p["rows"]] = p["listed"]
        for f, (total, (family, _, N)) in enumerate(zip(totals, self.scene.hard, strict=True)):
            keys = total.keys[total.values > 0.0]
            gained = np.full((K, len(keys)), np.nan)
            now = np.zeros(len(keys))
            gained[0] = 0.0
            for p in pieces:
                mine, values, last = p["pairs"][f]
                at = np.searchsorted(keys, mine)
                known = (
                    np.flatnonzero(keys[np.minimum(at, max(0, len(keys) - 1))] == mine)
                    if len(keys)
                    else at[:0]
                )
                block = np.broadcast_to(now, (values.shape[0], len(keys))).copy()
                block[:, at[known]] = values[:, known]
                gained[p["rows"]] = block
                now[at[known]] = last[known]
            names += [(family, int(v) // N, int(v) % N) for v in keys]
            columns.append(gained)
        order = sorted(range(len(names)), key=lambda c: names[c])
        return tuple(names[c] for c in order), np.concatenate(columns, axis=1)[:, order]


def _quadratures(program, listed, force, totals, tables) -> np.ndarray:
    """Return the quadratures (size,) with which a segment starts.

    listed: impulses of the listed constraints, force (n,): the reaction; totals: impulses of all
    pairs so far, of which those of the neighbour tables are taken.
    """
    quad = np.zeros(program.size)
    quad[program.columns] = listed
    quad[-len(force) :] = force
    for total, table, first in zip(totals, tables, program.offsets.values(), strict=True):
        quad[first : first + table.size] = total.of(_keys(table).ravel())
    return quad


def _pair_impulses(program, n, z, samples, totals, tables) -> list[tuple]:
    """Store the impulses of all pairs at the end z of a segment, and return those at its samples.

    By family: keys (q,) of the pairs, impulses (rows, q) at the samples, (q,) at the end.
    """
    out = []
    for total, table, first in zip(totals, tables, program.offsets.values(), strict=True):
        at, keys = _own(table)
        block = slice(n + first, n + first + table.size)
        total.put(keys, z[block][at])
        out.append((keys, samples[:, block][:, at], total.of(keys)))
    return out


def _table(i, j, N, capacity):
    """(N, capacity) partners of each particle in both directions, filled up with its own number."""
    table = np.repeat(np.arange(N)[:, None], capacity, axis=1)
    a = np.concatenate([i, j])
    b = np.concatenate([j, i])
    order = np.lexsort((b, a))
    a = a[order]
    b = b[order]
    table[a, np.arange(len(a)) - np.searchsorted(a, a)] = b
    return table


def _keys(table):
    """Key i N + j, i < j, of each entry; that of an entry which is no pair belongs to no pair."""
    N = len(table)
    own = np.arange(N)[:, None]
    return np.minimum(own, table) * N + np.maximum(own, table)


def _own(table):
    """(places in the flat table, keys) of the entries with i < j."""
    at = np.flatnonzero(table > np.arange(len(table))[:, None])
    return at, _keys(table).ravel()[at]
