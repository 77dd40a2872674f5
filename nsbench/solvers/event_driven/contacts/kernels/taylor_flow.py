"""Expand the flow on a set of active contacts in a Taylor series.

The drift is f = A x + c, or computed by a traced program (see traced_drift). The distance of an
active contact is d, so with  u = (x_i - x_j) / d  the flow is

    x' = f + sum_k mu_k u_k (e_i - e_j),     u_k . (x_i' - x_j') = 0,

and every order of mu costs one solve with the same Gram matrix (Taylor series of
differential-algebraic equations: Pryce 1998). lam = sign mu. Affine rows have their constant
gradient in place of u.

Arguments in common: active (p,) entries of the candidates, ascending; held, a HeldSet; contacts and
layout, see contact_arrays; norm (m,) lengths of the gradients.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from nsbench.compilation.decorators import inner_kernel, summing_kernel
from nsbench.dynamics.contacts.kernels.contact_arrays import PAIR, ROW
from nsbench.linalg.skyline_cholesky import factor, fill, solve
from nsbench.solvers.event_driven.contacts.kernels.traced_drift import extend_drift

if TYPE_CHECKING:
    from nsbench.dynamics.contacts.kernels.contact_arrays import Contacts, Layout
    from nsbench.solvers.event_driven.contacts.kernels.held_set import HeldSet
    from nsbench.solvers.event_driven.contacts.kernels.loop_state import AffineDrift, DriftProgram


@inner_kernel
def size(x: np.ndarray) -> float:
    """Return the largest |x_i| of x (n,); NaN if one is NaN."""
    top = 0.0
    for v in x:
        top = max(top, abs(v)) if v == v else np.nan
        if top != top:
            break
    return top


@inner_kernel
def copy_into(x: np.ndarray, out: np.ndarray) -> None:
    """Copy x (n,) to out (n,)."""
    for i in range(out.size):
        out[i] = x[i]


@inner_kernel
def sorted_index(W: np.ndarray, k: int) -> int:
    """Return the position of k in the ascending set W (p,), or where it would be inserted."""
    lo = 0
    hi = W.size
    # Bisection.
    while lo < hi:
        mid = (lo + hi) // 2
        if W[mid] < k:
            lo = mid + 1
        else:
            hi = mid
    return lo


@inner_kernel
def all_entries(m: int) -> np.ndarray:
    """Return 0, 1, .. m - 1 as an array (m,)."""
    out = np.empty(m, np.int64)
    for k in range(m):
        out[k] = k
    return out


@inner_kernel
def max_difference(x: np.ndarray, y: np.ndarray) -> float:
    """Return the largest |x_i - y_i| of x, y (n,); NaN if one is NaN."""
    top = 0.0
    for i in range(x.size):
        v = abs(x[i] - y[i])
        if v != v:
            return np.nan
        top = max(top, v)
    return top


@inner_kernel
def evaluate_gaps(
    entries: np.ndarray, contacts: Contacts, layout: Layout, x: np.ndarray, out: np.ndarray
) -> None:
    """Evaluate the gaps of some entries of the candidates at x (n,); out (entries,).

    A distance r has the value sign (r^2 - d^2) / (2 d), with the zero and the slope of its gap.
    Loops over entries stay in one function with the arrays unpacked: unpacking them per entry would
    count their references.
    """
    kind, p, q, d, sign, dim = contacts
    anchors, ptr, cols, vals, b = layout
    for a in range(entries.size):
        k = entries[a]
        if kind[k] == ROW:
            g = b[p[k]]
            for e in range(ptr[p[k]], ptr[p[k] + 1]):
                g += vals[e] * x[cols[e]]
            out[a] = g
        else:
            s = 0.0
            for c in range(dim[k]):
                u = x[p[k] + c] - (x[q[k] + c] if kind[k] == PAIR else anchors[q[k] + c])
                s += u * u
            out[a] = sign[k] * (s - d[k] * d[k]) / (2.0 * d[k])


@inner_kernel
def fill_gradients(
    active: np.ndarray,
    contacts: Contacts,
    layout: Layout,
    x: np.ndarray,
    C: np.ndarray,
    V: np.ndarray,
    count: np.ndarray,
    U: np.ndarray,
) -> None:
    """Fill the gradients of the active entries: columns, values, lengths; u in U[:, :, 0].

    x (n,): state. C, V (p, width), count (p,): short rows, distances up to their sign.
    """
    kind, p, q, d, _, dim = contacts
    anchors, ptr, cols, vals, _ = layout
    for a in range(active.size):
        k = active[a]
        count[a] = 0
        if kind[k] == ROW:
            for e in range(ptr[p[k]], ptr[p[k] + 1]):
                C[a, count[a]] = cols[e]
                V[a, count[a]] = vals[e]
                count[a] += 1
            continue
        m = dim[k]
        for c in range(m):
            U[a, c, 0] = (
                x[p[k] + c] - (x[q[k] + c] if kind[k] == PAIR else anchors[q[k] + c])
            ) / d[k]
            C[a, c] = p[k] + c
            V[a, c] = U[a, c, 0]
            if kind[k] == PAIR:
                C[a, m + c] = q[k] + c
                V[a, m + c] = -U[a, c, 0]
        count[a] = 2 * m if kind[k] == PAIR else m


@inner_kernel
def project_and_factor(
    active: np.ndarray,
    held: HeldSet,
    contacts: Contacts,
    layout: Layout,
    norm: np.ndarray,
    x: np.ndarray,
    work: np.ndarray,
    least_pivot: float,
    length: float,
) -> bool:
    """Project x onto g = 0 by Newton's method and factorise the Gram matrix there.

    x (n,): moved along the gradients, to the rounding of x and of `length`, the characteristic
    length of the case. work (n,): zeros. least_pivot: relative to its diagonal.
    Returns False if a pivot is too small or if four iterations do not converge.
    """
    C, V, count, U, _, plan, E = held
    p = active.size
    g = np.empty(active.size)
    rounding = 2e-15 * (length + size(x))
    # Newton's method, with the gradients and their Gram matrix at each iterate.
    for iteration in range(4):
        fill_gradients(active, contacts, layout, x, C, V, count, U)
        fill(plan, C, V, count, p, work, E)
        if not factor(plan, p, E, least_pivot):
            return False
        evaluate_gaps(active, contacts, layout, x, g)
        off = 0.0
        sign = contacts.sign
        for a in range(p):
            g[a] *= -sign[active[a]]
            off = max(off, abs(g[a]) / norm[active[a]])
        if off <= rounding or iteration == 3:
            return off <= 1e3 * rounding
        solve(plan, p, E, g, g)
        for a in range(p):
            for e in range(count[a]):
                x[C[a, e]] += V[a, e] * g[a]
        if off <= 16.0 * rounding:  # x moved by rounding: the factor is right to its last digits
            fill_gradients(active, contacts, layout, x, C, V, count, U)
            return True
    return True


@summing_kernel
def _self_convolution(U, k, c, m):
    """Sum u[a] u[m + 1 - a] over a = 1 .. m."""
    s = 0.0
    for a in range(1, m + 1):
        s += U[k, c, a] * U[k, c, m + 1 - a]
    return s


@summing_kernel
def _convolution(mu, U, k, c, m):
    """Sum mu[m - a] u[a] over a = 1 .. m."""
    s = 0.0
    for a in range(1, m + 1):
        s += mu[k, m - a] * U[k, c, a]
    return s


@inner_kernel
def _add_known_forces(m, active, contacts, mu, U, V):
    """Add to V the part of order m of the contact forces that is known before mu[m]."""
    kind, p, q, _, _, dim = contacts
    for a in range(active.size):
        k = active[a]
        if kind[k] != ROW:
            for c in range(dim[k]):
                s = _convolution(mu, U, a, c, m)
                V[p[k] + c] += s
                if kind[k] == PAIR:
                    V[q[k] + c] -= s


@inner_kernel
def _extend_affine_drift(m, drift, X, F):
    """Compute F[m], order m of A x + constant, from X[m]."""
    ptr, cols, vals, const = drift
    for i in range(const.size):
        s = const[i] if m == 0 else 0.0
        for e in range(ptr[i], ptr[i + 1]):
            s += vals[e] * X[m, cols[e]]
        F[m, i] = s


@inner_kernel
def extend_series(
    m0: int,
    m1: int,
    t: float,
    active: np.ndarray,
    held: HeldSet,
    contacts: Contacts,
    drift: AffineDrift,
    program: DriftProgram,
    X: np.ndarray,
    F: np.ndarray,
) -> None:
    """Compute the orders m0 to m1 - 1 of mu and of the drift F, and those of X and u up to m1.

    t: the time that the series is about.

    X (K, n), K = order + 1: coefficients of the state; F (order, n): of the drift.
    X[m + 1] = (F[m] + (G^T mu)[m]) / (m + 1), where mu[m] makes the term of order m of G x' vanish.
    """
    kind, p, q, d, _, dim = contacts
    C, G, count, U, mu, plan, E = held
    rhs = np.empty(active.size)
    # Taylor series of the constrained flow, order by order: known forces, multipliers, velocity.
    for m in range(m0, m1):
        V = X[m + 1]
        if program.out.size > 0:
            extend_drift(m, t, program, X, F)
        else:
            _extend_affine_drift(m, drift, X, F)
        for i in range(V.size):
            V[i] = F[m, i]
        if m > 0:
            _add_known_forces(m, active, contacts, mu, U, V)
        # order m of G x' = 0: known terms on the right-hand side, one solve for mu[m]
        for a in range(active.size):
            k = active[a]
            s = 0.0
            if kind[k] != ROW and m > 0:
                for c in range(dim[k]):
                    s += _self_convolution(U, a, c, m)
                s *= 0.5 * (m + 1) * d[k]
            for e in range(count[a]):
                s += G[a, e] * V[C[a, e]]
            rhs[a] = -s
        solve(plan, active.size, E, rhs, rhs)
        for a in range(active.size):
            mu[a, m] = rhs[a]
            for e in range(count[a]):
                V[C[a, e]] += G[a, e] * rhs[a]
        for i in range(V.size):
            V[i] /= m + 1
        for a in range(active.size):
            k = active[a]
            if kind[k] != ROW:
                for c in range(dim[k]):
                    U[a, c, m + 1] = (V[p[k] + c] - (V[q[k] + c] if kind[k] == PAIR else 0.0)) / d[
                        k
                    ]


@inner_kernel
def step_length(X: np.ndarray, mu: np.ndarray, deg: int, eps: float, active: np.ndarray) -> float:
    """Return the step on which the terms of the two highest orders stay below eps (1 + |x|).

    Jorba & Zou 2005, section 3.2, with the impulses as further states. 0.0 if a term is not finite.
    X (K, n), mu (p, order): coefficients of the state and of the multipliers, used up to deg.
    """
    # the two highest orders: one of them may vanish by symmetry
    allowed = eps * (1.0 + size(X[0]))
    h = np.inf
    for j in range(deg - 1, deg + 1):
        top = size(X[j])
        for a in range(active.size):
            top = max(top, abs(mu[a, j - 1]) / j)  # coefficient of the impulse
        if not np.isfinite(top):
            return 0.0
        if top > 0.0:
            h = min(h, (allowed / top) ** (1.0 / j))
    return 0.9 * h  # safety factor for the terms left out


@inner_kernel
def evaluate_series(X: np.ndarray, deg: int, s: float, out: np.ndarray) -> None:
    """Evaluate the series X (K, n) of the state at s by Horner's rule up to deg; fills out (n,)."""
    for i in range(out.size):
        out[i] = X[deg, i]
    for j in range(deg - 1, -1, -1):
        for i in range(out.size):
            out[i] = out[i] * s + X[j, i]
