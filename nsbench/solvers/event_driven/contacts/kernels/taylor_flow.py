"""Taylor series of the flow on a set of contacts held at zero, for drifts f = A x + c; contacts as
in contacts.Near.

A held distance is d, so with  u = (x_i - x_j) / d  the flow is  x' = f + sum mu_k u_k (e_i - e_j),
u_k . (x_i' - x_j') = 0, and every order of mu costs one solve with the same Gram matrix (Taylor
series of differential-algebraic equations:
Pryce 1998). lam = sign mu. Affine rows have their gradient in place of u, which stands still.
"""

import numpy as np

from nsbench.compilation.decorators import inner_kernel, summing_kernel
from nsbench.linalg.skyline_cholesky import factor, fill, solve


@inner_kernel
def size(x):
    """Largest |x_i|; NaN if one is."""
    top = 0.0
    for v in x:
        top = max(top, abs(v)) if v == v else np.nan
        if top != top:
            break
    return top


@inner_kernel
def copied(x, out):
    """out <- x."""
    for i in range(out.size):
        out[i] = x[i]


@inner_kernel
def sorted_index(W, k):
    """Where k is, or belongs, in the ascending W."""
    lo = 0
    hi = W.size
    while lo < hi:
        mid = (lo + hi) // 2
        if W[mid] < k:
            lo = mid + 1
        else:
            hi = mid
    return lo


@inner_kernel
def apart(x, y):
    """Largest |x_i - y_i|; NaN if one is."""
    top = 0.0
    for i in range(x.size):
        v = abs(x[i] - y[i])
        if v != v:
            return np.nan
        top = max(top, v)
    return top


@inner_kernel
def gaps(index, listed, places, x, out):
    """out (m,): g of the entries `index` of the list; distances as sign (|u|^2 - d^2) / (2 d),
    which has g's zero and slope.

    Loops over entries stay in one function with the arrays unpacked: to unpack them per entry
    counts their references.
    """
    kind, p, q, d, sign, dim = listed
    anchors, ptr, cols, vals, b = places
    for a in range(index.size):
        k = index[a]
        if kind[k] == 0:
            g = b[p[k]]
            for e in range(ptr[p[k]], ptr[p[k] + 1]):
                g += vals[e] * x[cols[e]]
            out[a] = g
        else:
            s = 0.0
            for c in range(dim[k]):
                u = x[p[k] + c] - (x[q[k] + c] if kind[k] == 1 else anchors[q[k] + c])
                s += u * u
            out[a] = sign[k] * (s - d[k] * d[k]) / (2.0 * d[k])


@inner_kernel
def gradients(W, listed, places, x, C, V, count, U):
    """Rows of the held entries W: columns, values, lengths; u in U[:, :, 0]."""
    kind, p, q, d, _, dim = listed
    anchors, ptr, cols, vals, _ = places
    for a in range(W.size):
        k = W[a]
        count[a] = 0
        if kind[k] == 0:
            for e in range(ptr[p[k]], ptr[p[k] + 1]):
                C[a, count[a]] = cols[e]
                V[a, count[a]] = vals[e]
                count[a] += 1
            continue
        m = dim[k]
        for c in range(m):
            U[a, c, 0] = (x[p[k] + c] - (x[q[k] + c] if kind[k] == 1 else anchors[q[k] + c])) / d[k]
            C[a, c] = p[k] + c
            V[a, c] = U[a, c, 0]
            if kind[k] == 1:
                C[a, m + c] = q[k] + c
                V[a, m + c] = -U[a, c, 0]
        count[a] = 2 * m if kind[k] == 1 else m


@inner_kernel
def project_and_factor(W, gear, listed, places, norm, x, work, least, unit):
    """x is put on g = 0 along the gradients there, and the Gram matrix factored; False if that
    cannot be done.

    unit: the size of a scene; to rounding of that and of x.
    """
    C, V, count, U, _, plan, E = gear
    p = W.size
    g = np.empty(W.size)
    fine = 2e-15 * (unit + size(x))
    for turn in range(4):
        gradients(W, listed, places, x, C, V, count, U)
        fill(plan, C, V, count, p, work, E)
        if not factor(plan, p, E, least):
            return False
        gaps(W, listed, places, x, g)
        far = 0.0
        sign = listed[4]
        for a in range(p):
            g[a] *= -sign[W[a]]
            far = max(far, abs(g[a]) / norm[W[a]])
        if far <= fine or turn == 3:
            return far <= 1e3 * fine
        solve(plan, p, E, g, g)
        for a in range(p):
            for e in range(count[a]):
                x[C[a, e]] += V[a, e] * g[a]
        if far <= 16.0 * fine:  # moved by rounding: the factor stays right to the last digits
            gradients(W, listed, places, x, C, V, count, U)
            return True
    return True


@summing_kernel
def _fold(U, k, c, m):
    """sum_{a=1}^m u[a] u[m+1-a]."""
    s = 0.0
    for a in range(1, m + 1):
        s += U[k, c, a] * U[k, c, m + 1 - a]
    return s


@summing_kernel
def _mixed(mu, U, k, c, m):
    """sum_{a=1}^m mu[m-a] u[a]."""
    s = 0.0
    for a in range(1, m + 1):
        s += mu[k, m - a] * U[k, c, a]
    return s


@inner_kernel
def _push(m, W, listed, mu, U, V):
    """V += the part of order m of the forces that is known before mu[m]."""
    kind, p, q, _, _, dim = listed
    for a in range(W.size):
        k = W[a]
        if kind[k] > 0:
            for c in range(dim[k]):
                s = _mixed(mu, U, a, c, m)
                V[p[k] + c] += s
                if kind[k] == 1:
                    V[q[k] + c] -= s


@inner_kernel
def extend_series(m0, m1, W, gear, listed, drift, X, F):
    """Orders m0 to m1 - 1 of mu (p, .) and of the drift F (., n); so X (., n) and U up to order
    m1."""
    kind, p, q, d, _, dim = listed
    aptr, acols, avals, const = drift
    C, G, count, U, mu, plan, E = gear
    rhs = np.empty(W.size)
    for m in range(m0, m1):
        V = X[m + 1]
        for i in range(const.size):
            s = const[i] if m == 0 else 0.0
            for e in range(aptr[i], aptr[i + 1]):
                s += avals[e] * X[m, acols[e]]
            F[m, i] = s
            V[i] = s
        if m > 0:
            _push(m, W, listed, mu, U, V)
        for a in range(W.size):
            k = W[a]
            s = 0.0
            if kind[k] > 0 and m > 0:
                for c in range(dim[k]):
                    s += _fold(U, a, c, m)
                s *= 0.5 * (m + 1) * d[k]
            for e in range(count[a]):
                s += G[a, e] * V[C[a, e]]
            rhs[a] = -s
        solve(plan, W.size, E, rhs, rhs)
        for a in range(W.size):
            mu[a, m] = rhs[a]
            for e in range(count[a]):
                V[C[a, e]] += G[a, e] * rhs[a]
        for i in range(const.size):
            V[i] /= m + 1
        for a in range(W.size):
            k = W[a]
            if kind[k] > 0:
                for c in range(dim[k]):
                    U[a, c, m + 1] = (V[p[k] + c] - (V[q[k] + c] if kind[k] == 1 else 0.0)) / d[k]


@inner_kernel
def step_length(X, mu, deg, eps, W):
    """How far the terms of the two highest orders stay below eps (1 + |x|): Jorba & Zou 2005,
    section 3.2."""
    fine = eps * (1.0 + size(X[0]))
    h = np.inf
    for j in range(deg - 1, deg + 1):
        top = size(X[j])
        for a in range(W.size):
            top = max(top, abs(mu[a, j - 1]) / j)  # of the impulse
        if not np.isfinite(top):
            return 0.0
        if top > 0.0:
            h = min(h, (fine / top) ** (1.0 / j))
    return 0.9 * h


@inner_kernel
def at(X, deg, s, out):
    """out (n,): the series at s."""
    for i in range(out.size):
        out[i] = X[deg, i]
    for j in range(deg - 1, -1, -1):
        for i in range(out.size):
            out[i] = out[i] * s + X[j, i]
