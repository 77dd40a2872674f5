"""One step of the catching-up scheme: linearised gaps and the projection on them, over a list.

    min |y - z|^2  s.t.  g_k(x) + grad g_k(x) (y - x) >= 0  for all candidates k of the list

x (n,): the state at the start of the step, z (n,): Euler's step from it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from nsbench.compilation.decorators import inner_kernel
from nsbench.dynamics.contacts.kernels.contact_arrays import (
    PAIR,
    ROW,
    AffineRows,
    ListedContacts,
)
from nsbench.linalg.sparse_ldl import SparsityPattern
from nsbench.qp.kernels import active_set
from nsbench.qp.kernels.dispatch import solve_projection
from nsbench.solvers.catching_up.kernels.candidates import gather, gradient_pattern

QPS, ROUNDS, REBUILDS, PEAK, LIMITS, TIES, WORST, ACTING = range(8)  # places of the counters


class ContactScene(NamedTuple):
    """The constraints of a problem.

    static: ListedContacts by family; rows: AffineRows; b, anchors: of the present time; hard
    (k, 4), radii: see candidates.gather.
    """

    static: ListedContacts
    rows: AffineRows
    b: np.ndarray
    anchors: np.ndarray
    hard: np.ndarray
    radii: np.ndarray


class CandidateList(NamedTuple):
    """Candidates for contact: keys (m,), the pattern of their gradients, and impulses (m,) since
    the last sample."""

    contacts: ListedContacts
    keys: np.ndarray
    pattern: SparsityPattern
    impulse: np.ndarray


@inner_kernel
def list_candidates(x, skin, scene):
    """Return the CandidateList of all pairs with a gap of at most skin at x, without impulses."""
    contacts, keys = gather(x, skin, scene.static, scene.hard, scene.radii)
    ptr, cols = gradient_pattern(contacts, scene.rows.ptr, scene.rows.cols)
    pattern = active_set.outline(ptr, cols, x.size)
    return CandidateList(contacts, keys, pattern, np.zeros(keys.size))


@inner_kernel
def linearise(
    contacts: ListedContacts,
    rows: AffineRows,
    b: np.ndarray,
    anchors: np.ndarray,
    x: np.ndarray,
    ptr: np.ndarray,
    vals: np.ndarray,
    g: np.ndarray,
) -> None:
    """Fill the gaps g (m,) and the entries vals of their gradients at x (n,).

    contacts: ListedContacts; rows: AffineRows; ptr (m + 1,): first entry of each gradient. A
    distance of zero has the first axis for its direction.
    """
    kind = contacts.kind
    p = contacts.p
    q = contacts.q
    d = contacts.d
    sign = contacts.sign
    dim = contacts.dim
    for k in range(kind.size):
        at = ptr[k]
        if kind[k] == ROW:
            s = b[p[k]]
            for e in range(rows.ptr[p[k]], rows.ptr[p[k] + 1]):
                s += rows.vals[e] * x[rows.cols[e]]
                vals[at] = rows.vals[e]
                at += 1
            g[k] = s
            continue
        s = 0.0
        for c in range(dim[k]):
            e = x[p[k] + c] - (x[q[k] + c] if kind[k] == PAIR else anchors[q[k] + c])
            vals[at + c] = e
            s += e * e
        r = np.sqrt(s)
        g[k] = sign[k] * (r - d[k])
        if r == 0.0:
            vals[at] = 1.0
            r = 1.0
        for c in range(dim[k]):
            vals[at + c] *= sign[k] / r
            if kind[k] == PAIR:
                vals[at + dim[k] + c] = -vals[at + c]


@inner_kernel
def project(exact, many, near, book, store, scene, x, z, guess, count):
    """Solve for the point y nearest to z where the gaps linearised at x are not negative.

    exact, many, book, store: see qp.kernels.dispatch; near: CandidateList; guess (m,): multipliers
    to begin with; count: counters. Returns mu (m,), d = y - z (n,), the code of active_set, the KKT
    residual, book, store.
    """
    contacts = near.contacts
    P = near.pattern
    ptr = P.ptr
    m = guess.size
    vals = np.empty(ptr[m])
    w = np.empty(m)
    q = np.empty(m)
    scale = 1.0
    linearise(contacts, scene.rows, scene.b, scene.anchors, x, ptr, vals, w)
    e = np.empty(x.size)
    work = np.zeros(4, np.int64)
    for c in range(x.size):
        scale = max(scale, abs(x[c]), abs(z[c]))
        e[c] = z[c] - x[c]
    active_set.slack(P, vals, w, e, q)
    clear = True
    for k in range(m):
        clear = clear and q[k] >= 0.0
    if clear:
        return np.zeros(m), np.zeros(x.size), np.int64(active_set.SOLVED), 0.0, book, store
    mu, d, book, store = solve_projection(exact, many, P, book, store, vals, q, guess, scale, work)
    count[QPS] += 1
    count[ROUNDS] += work[1]
    count[WORST] = max(count[WORST], work[1])
    count[LIMITS] += work[0] == active_set.MAXITER
    for k in range(m):  # an impulse between coincident centres has no direction
        count[TIES] += (
            contacts.kind[k] != ROW and mu[k] > 0.0 and w[k] == -contacts.sign[k] * contacts.d[k]
        )
    return mu, d, work[0], active_set.residual(P, vals, q, mu, d), book, store
