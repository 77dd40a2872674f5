"""Evaluate gaps and gradients of listed contacts, and the velocity with some of them active.

The arrays are those of contact_arrays.Contacts and Layout, one by one: Python calls these kernels
in every evaluation, and a NamedTuple takes longer to unpack than its arrays. Gradients are short
rows (C, V, count): columns (m, width), values (m, width) and numbers of entries (m,). Smooth
constraints are evaluated by the caller: their gradients come as row `slot` of `dense`.
"""

import numpy as np

from nsbench.compilation.decorators import njit
from nsbench.dynamics.contacts.kernels.contact_arrays import PAIR, ROW, SMOOTH


@njit(cache=True, error_model="numpy")
def fill_gaps(
    kind: np.ndarray,
    p: np.ndarray,
    q: np.ndarray,
    d: np.ndarray,
    sign: np.ndarray,
    dim: np.ndarray,
    x: np.ndarray,
    anchors: np.ndarray,
    ptr: np.ndarray,
    cols: np.ndarray,
    vals: np.ndarray,
    b: np.ndarray,
    out: np.ndarray,
) -> None:
    """Fill out (m,) with the gaps of rows, pairs and anchors; smooth constraints are skipped.

    kind, p, q, d, sign, dim (m,): see contact_arrays.Contacts; anchors, ptr, cols, vals, b: see
    contact_arrays.Layout; x (n,): state. Gaps of distances are in the unit of x.
    """
    for k in range(kind.size):
        if kind[k] == ROW:
            g = b[p[k]]
            for e in range(ptr[p[k]], ptr[p[k] + 1]):
                g += vals[e] * x[cols[e]]
            out[k] = g
        elif kind[k] != SMOOTH:
            s = 0.0
            for c in range(dim[k]):
                u = x[p[k] + c] - (x[q[k] + c] if kind[k] == PAIR else anchors[q[k] + c])
                s += u * u
            out[k] = sign[k] * (np.sqrt(s) - d[k])


@njit(cache=True, error_model="numpy")
def fill_rows(
    kind: np.ndarray,
    p: np.ndarray,
    q: np.ndarray,
    sign: np.ndarray,
    dim: np.ndarray,
    slot: np.ndarray,
    x: np.ndarray,
    anchors: np.ndarray,
    ptr: np.ndarray,
    cols: np.ndarray,
    vals: np.ndarray,
    dense: np.ndarray,
    width: int,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the gradients as short rows: columns C (m, width), values V (m, width), count (m,).

    kind, p, q, sign, dim (m,): see contact_arrays.Contacts. x (n,): state. slot (m,): row of
    `dense` (smooth, n) for smooth constraints. width: entries of the longest gradient.
    """
    m = kind.size
    C = np.zeros((m, width), np.int64)
    V = np.zeros((m, width))
    count = np.zeros(m, np.int64)
    # Gradient of a distance: the unit vector between the points, opposite for the second particle.
    for k in range(m):
        if kind[k] == ROW:
            for e in range(ptr[p[k]], ptr[p[k] + 1]):
                C[k, count[k]] = cols[e]
                V[k, count[k]] = vals[e]
                count[k] += 1
        elif kind[k] == SMOOTH:
            for c in range(x.size):
                C[k, c] = c
                V[k, c] = dense[slot[k], c]
            count[k] = x.size
        else:
            s = 0.0
            pair = kind[k] == PAIR
            for c in range(dim[k]):
                u = x[p[k] + c] - (x[q[k] + c] if pair else anchors[q[k] + c])
                V[k, c] = u
                s += u * u
            r = np.sqrt(s)
            for c in range(dim[k]):
                C[k, c] = p[k] + c
                V[k, c] *= sign[k] / r
                if pair:
                    C[k, dim[k] + c] = q[k] + c
                    V[k, dim[k] + c] = -V[k, c]
            count[k] = 2 * dim[k] if pair else dim[k]
    return C, V, count


@njit(cache=True, error_model="numpy")
def gram(C: np.ndarray, V: np.ndarray, count: np.ndarray, n: int) -> np.ndarray:
    """Return the Gram matrix G G^T, (m, m), of the rows C, V (m, width), count (m,)."""
    m = count.size
    M = np.zeros((m, m))
    work = np.zeros(n)
    # Scatter row k into a dense vector, multiply by the rows up to k, clear it again.
    for k in range(m):
        for e in range(count[k]):
            work[C[k, e]] += V[k, e]
        for a in range(k + 1):
            s = 0.0
            for e in range(count[a]):
                s += V[a, e] * work[C[a, e]]
            M[k, a] = s
            M[a, k] = s
        for e in range(count[k]):
            work[C[k, e]] = 0.0
    return M


@njit(cache=True, error_model="numpy")
def times(C: np.ndarray, V: np.ndarray, count: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return G x, (m,), for x (n,)."""
    out = np.zeros(count.size)
    for k in range(count.size):
        for e in range(count[k]):
            out[k] += V[k, e] * x[C[k, e]]
    return out


@njit(cache=True, error_model="numpy")
def add_transposed(
    C: np.ndarray, V: np.ndarray, count: np.ndarray, lam: np.ndarray, out: np.ndarray
) -> None:
    """Add G^T lam to out (n,), lam (m,)."""
    for k in range(count.size):
        for e in range(count[k]):
            out[C[k, e]] += lam[k] * V[k, e]


@njit(cache=True, error_model="numpy")
def gram_solve(M: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Solve M z = v by Cholesky's method; NaN if M is not positive definite.

    M (m, m): overwritten by its factor; v (m,). Returns z (m,).
    """
    m = v.size
    # Cholesky's method by rows.
    for a in range(m):
        for b in range(a + 1):
            s = M[a, b]
            for c in range(b):
                s -= M[a, c] * M[b, c]
            if a == b:
                M[a, a] = np.sqrt(s) if s > 0.0 else np.nan
            else:
                M[a, b] = s / M[b, b]
    out = v.copy()
    # Forward and backward substitution.
    for a in range(m):
        for b in range(a):
            out[a] -= M[a, b] * out[b]
        out[a] /= M[a, a]
    for a in range(m - 1, -1, -1):
        for b in range(a + 1, m):
            out[a] -= M[b, a] * out[b]
        out[a] /= M[a, a]
    return out


@njit(cache=True, error_model="numpy")
def constrained_velocity(
    C: np.ndarray, V: np.ndarray, count: np.ndarray, f: np.ndarray, rate: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return (x', lam, G^T lam) with all these contacts active, which must be independent.

    x' = f + G^T lam,  (G G^T) lam = -(G f + rate);  f (n,): drift; rate (m,): partial time
    derivatives of the gaps. Returns x' (n,), lam (m,), G^T lam (n,).
    """
    lam = gram_solve(gram(C, V, count, f.size), -(times(C, V, count, f) + rate))
    reaction = np.zeros(f.size)
    add_transposed(C, V, count, lam, reaction)
    return f + reaction, lam, reaction
