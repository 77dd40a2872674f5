"""Multifrontal Cholesky factorisation of K = I + G^T W G for any weights W >= 0 of the rows of G.

K is never smaller than I, whatever rows depend on each other: no pivot can be smaller than one. A
front holds the coordinates of a part and those behind it that it meets (see
nested_dissection.AssemblyTree, T below); what is left of it when its own are eliminated is handed
up (Duff & Reid, ACM TOMS 9(3), 1983). Fronts and panels of the factor are stored by rows, upper
triangle.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from nsbench.compilation.decorators import inner_kernel, summing_kernel
from nsbench.linalg.nested_dissection import LARGEST_FRONT, STACK

if TYPE_CHECKING:
    from nsbench.linalg.nested_dissection import AssemblyTree

BLOCK = 8  # rows eliminated together; _subtract_block is written out for as many


class FrontWorkspace(NamedTuple):
    """L: panels of the factor. F: the largest front, flat. stack: what children hand up. work: two
    right-hand sides, by places and of a front."""

    L: np.ndarray
    F: np.ndarray
    stack: np.ndarray
    work: np.ndarray


# here and below: vector sums, as a factor is corrected by refinement anyway
@summing_kernel
def _subtract_block(F, nf, L, t, first):
    """Subtract from rows first .. of the front the product of the BLOCK panel rows at L[t:]."""
    for i in range(first, nf):
        row = F[i * nf + i : i * nf + nf]
        r0 = L[t + i : t + nf]
        r1 = L[t + nf + i : t + 2 * nf]
        r2 = L[t + 2 * nf + i : t + 3 * nf]
        r3 = L[t + 3 * nf + i : t + 4 * nf]
        r4 = L[t + 4 * nf + i : t + 5 * nf]
        r5 = L[t + 5 * nf + i : t + 6 * nf]
        r6 = L[t + 6 * nf + i : t + 7 * nf]
        r7 = L[t + 7 * nf + i : t + 8 * nf]
        a0 = r0[0]
        a1 = r1[0]
        a2 = r2[0]
        a3 = r3[0]
        a4 = r4[0]
        a5 = r5[0]
        a6 = r6[0]
        a7 = r7[0]
        for j in range(nf - i):
            row[j] -= (
                a0 * r0[j]
                + a1 * r1[j]
                + a2 * r2[j]
                + a3 * r3[j]
                + a4 * r4[j]
                + a5 * r5[j]
                + a6 * r6[j]
                + a7 * r7[j]
            )


@summing_kernel
def eliminate(F: np.ndarray, own: int, nf: int, L: np.ndarray, at: int) -> None:
    """Eliminate the first `own` rows of the front F (nf * nf,), stored by rows; they go to L[at:],
    their diagonal inverted.

    BLOCK rows at a time. (Rows as slices, read from 0 on: an index that might be negative keeps
    numba from vectorising.)
    """
    k = 0
    # blocked right-looking Cholesky factorisation of a dense front
    while k < own:
        wide = min(BLOCK, own - k)
        for a in range(wide):
            r = (k + a) * nf
            g = at + (k + a) * nf
            size = nf - k - a
            row = F[r + k + a : r + nf]
            out = L[g + k + a : g + nf]
            for b in range(a):
                t = at + (k + b) * nf
                above = L[t + k + a : t + nf]
                f = above[0]
                for j in range(size):
                    row[j] -= f * above[j]
            p = 1.0 / np.sqrt(max(row[0], 1.0))
            for j in range(size):
                out[j] = row[j] * p
        t = at + k * nf
        if wide == BLOCK:
            _subtract_block(F, nf, L, t, k + BLOCK)
        else:
            for i in range(k + wide, nf):
                row = F[i * nf + i : i * nf + nf]
                for b in range(wide):
                    above = L[t + b * nf + i : t + b * nf + nf]
                    f = above[0]
                    for j in range(nf - i):
                        row[j] -= f * above[j]
        for a in range(wide):
            g = at + (k + a) * (nf + 1)
            L[g] = 1.0 / L[g]
        k += wide


@inner_kernel
def _add(F, nf, below, far, rel, ends):
    """Add what a child has left (far x far, upper triangle) to the front at the places rel (far,),
    run by run (extend-add).

    Places that follow each other are added as slices: they are read and written several times as
    fast as one by one.
    """
    # runs of places that follow each other
    runs = 0
    for j in range(far):
        if j + 1 == far or rel[j + 1] != rel[j] + 1:
            ends[runs] = j + 1
            runs += 1
    run = 0
    for i in range(far):
        if ends[run] <= i:
            run += 1
        j = i
        for u in range(run, runs):
            at = rel[i] * nf + rel[j]
            row = below[i * far + j : i * far + ends[u]]
            out = F[at : at + ends[u] - j]
            for b in range(row.size):
                out[b] += row[b]
            j = ends[u]


@inner_kernel
def factor(T: AssemblyTree, ptr, vals, weight, L, F, stack) -> None:
    """Fill L with the factor of I + G^T diag(weight) G, weight (m,).

    G (m, n) has the row pointers ptr (m + 1,) and the entries vals (e,). L, F and stack: see
    FrontWorkspace.
    """
    first = T.first
    up = T.up
    bptr = T.bptr
    rel = T.rel
    panel = T.panel
    optr = T.optr
    orow = T.orow
    loc = T.loc
    parts = first.size - 1
    top = 0
    waiting = np.empty(parts + 1, np.int64)
    sizes = 0
    ends = np.empty(T.sizes[LARGEST_FRONT], np.int64)
    # multifrontal method: assemble the front of a part, add what its children left, eliminate
    for s in range(parts):
        own = first[s + 1] - first[s]
        nf = own + bptr[s + 1] - bptr[s]
        for i in range(nf):
            row = F[i * nf + i : i * nf + nf]
            for j in range(row.size):
                row[j] = 0.0
            row[0] = 1.0 if i < own else 0.0
        for o in range(optr[s], optr[s + 1]):
            k = orow[o]
            if weight[k] == 0.0:
                continue
            for a in range(ptr[k], ptr[k + 1]):
                v = weight[k] * vals[a]
                r = loc[a]
                for b in range(ptr[k], ptr[k + 1]):
                    if loc[b] >= r:
                        F[r * nf + loc[b]] += v * vals[b]
        while sizes > 0 and up[waiting[sizes - 1]] == s:  # what its children have left
            sizes -= 1
            c = waiting[sizes]
            lo = bptr[c]
            far = bptr[c + 1] - bptr[c]
            top -= far * far
            _add(F, nf, stack[top : top + far * far], far, rel[lo : lo + far], ends)
        eliminate(F, own, nf, L, panel[s])
        far = nf - own
        for i in range(far):
            row = F[(own + i) * (nf + 1) : (own + i + 1) * nf]
            out = stack[top + i * far + i : top + i * far + far]
            for j in range(out.size):
                out[j] = row[j]
        top += far * far
        waiting[sizes] = s
        sizes += 1


@summing_kernel
def forward(T: AssemblyTree, L: np.ndarray, s: int, y: np.ndarray, z: np.ndarray) -> None:
    """Eliminate part s from a right-hand side (forward substitution).

    z (nf,) holds that of the front, overwritten; y (n,), by places, takes the result.
    """
    first = T.first
    bptr = T.bptr
    border = T.border
    panel = T.panel
    lo = first[s]
    own = first[s + 1] - first[s]
    far = bptr[s + 1] - bptr[s]
    for k in range(own):
        r = panel[s] + k * (own + far)
        row = L[r + k : r + own + far]
        rest = z[k:]
        v = rest[0] * row[0]
        y[lo + k] = v
        for j in range(row.size):
            rest[j] -= v * row[j]
    for i in range(far):
        y[border[bptr[s] + i]] += z[own + i]


@summing_kernel
def backward(T: AssemblyTree, L: np.ndarray, y: np.ndarray, z: np.ndarray) -> None:
    """Substitute backwards: y (n,) by places, from the end of `forward` to the solution; z:
    work."""
    # parents before children: what a front holds beside its own places is known by then
    first = T.first
    bptr = T.bptr
    border = T.border
    panel = T.panel
    for s in range(first.size - 2, -1, -1):
        lo = first[s]
        own = first[s + 1] - first[s]
        far = bptr[s + 1] - bptr[s]
        for i in range(far):
            z[own + i] = y[border[bptr[s] + i]]
        for k in range(own - 1, -1, -1):
            r = panel[s] + k * (own + far)
            v = 0.0
            row = L[r + k : r + own + far]
            rest = z[k:]
            rest[0] = 0.0
            for j in range(row.size):
                v += row[j] * rest[j]
            rest[0] = y[lo + k] = (y[lo + k] - v) * row[0]


@inner_kernel
def solve(T: AssemblyTree, L: np.ndarray, b: np.ndarray, x: np.ndarray, w: np.ndarray) -> None:
    """Fill x with K^-1 b, b, x (n,). w: FrontWorkspace.work. b and x may be the same array."""
    order = T.order
    first = T.first
    bptr = T.bptr
    n = order.size
    y = w[:n]
    z = w[n:]
    # right-hand side by places, children before parents
    for c in range(n):
        y[c] = b[order[c]]
    for s in range(first.size - 1):
        lo = first[s]
        own = first[s + 1] - first[s]
        far = bptr[s + 1] - bptr[s]
        for i in range(own):
            z[i] = y[lo + i]
        for i in range(far):
            z[own + i] = 0.0
        forward(T, L, s, y, z)
    backward(T, L, y, z)
    for c in range(n):
        x[order[c]] = y[c]


@inner_kernel
def workspace(T: AssemblyTree) -> FrontWorkspace:
    """Return the FrontWorkspace for the assembly tree T."""
    size = T.sizes[LARGEST_FRONT]
    most = T.sizes[STACK]
    return FrontWorkspace(
        np.empty(T.panel[T.panel.size - 1]),
        np.empty(size * size),
        np.empty(most + 1),
        np.empty(T.order.size + size),
    )
