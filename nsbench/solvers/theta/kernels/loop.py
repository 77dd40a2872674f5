"""Time loop of implicit theta stepping: one linear complementarity problem per step.

    x+ = x + h ((1 - th) f(t, x) + th f(t + h, x+) + B lam)
    0 <= lam _|_ D lam + (1 - th) v + th v+ + E (1 - th) (v+ - v) >= 0
    v = C x + q(t),   v+ = C x+ + q(t + h)

E picks the rows that constrain the state alone; these hold at the end of the step. Held at the mean
they would let the state swing about the constraint for ever (th = 1/2). The other rows determine
lam, so they belong to the time that lam belongs to. E is the projector on the left null space of
D_II, I the rows with lam > 0: found by repeating the step at most 3 times.
"""

import numpy as np

from nsbench.compilation.decorators import njit
from nsbench.lcp.lemke import has_other_motion, least_norm_solution, scales, solve
from nsbench.linalg.gauss_elimination import solve_gauss
from nsbench.linalg.max_norm import largest
from nsbench.solvers.common.kernels.step_code import StepCode, state_code

NEWTON = 50  # iterations; the matrix is made anew when one gains less than a factor of ten
AGAIN = 3  # repetitions of a step whose rows changed their kind
LARGE = 10.0  # times the way of the drift: pushes beyond are jumps of the state
LCPS, PIVOTS, INNER, CALLS, UNSETTLED = range(5)


@njit(cache=True, error_model="numpy")
def at_end(D, fixed, on):
    """Return the projector E (m, m) on rows without lam (fixed) and the left null space of D_II.

    on (m,): the rows I of the support.
    """
    m = fixed.size
    E = np.zeros((m, m))
    idx = np.empty(m, np.int64)
    p = 0
    top = 0.0
    for i in range(m):
        if on[i] and not fixed[i]:
            idx[p] = i
            p = p + 1
        for j in range(m):
            top = max(top, abs(D[i, j]))
    if p:
        S = np.empty((p, p))
        for i in range(p):
            for j in range(p):
                S[i, j] = D[idx[i], idx[j]]
        # Left singular vectors of vanishing singular values span the left null space.
        U, sigma, _ = np.linalg.svd(S)
        for k in range(p):
            if not sigma[k] > 1e-10 * top:
                for i in range(p):
                    for j in range(p):
                        E[idx[i], idx[j]] += U[i, k] * U[j, k]
    for i in range(m):
        if fixed[i]:
            E[i, i] = 1.0
    return E


@njit(cache=True, error_model="numpy")
def jacobian(f, t, x, J):
    """Compute df/dx in J by one-sided differences; return the calls of f."""
    n = x.size
    a = np.empty(n)
    b = np.empty(n)
    y = x.copy()
    f(t, y, a)
    for j in range(n):
        y[j] = x[j] + 1.5e-8 * max(
            1.0, abs(x[j])
        )  # sqrt(eps): half of the digits, enough for Newton
        f(t, y, b)
        for i in range(n):
            J[i, j] = (b[i] - a[i]) / (y[j] - x[j])
        y[j] = x[j]
    return n + 1


@njit(cache=True, error_model="numpy")
def times(A, x, out):
    """Multiply: out <- A x."""
    for i in range(A.shape[0]):
        out[i] = 0.0
        for j in range(A.shape[1]):
            out[i] += A[i, j] * x[j]


@njit(cache=True, error_model="numpy")
def matrices(J, h, theta, B, W, G):
    """Compute W <- (I - h th J)^-1 and G <- h W B; return False if the matrix is singular."""
    n = J.shape[0]
    K = np.empty((n, n))
    e = np.empty(n)
    for c in range(n):
        for i in range(n):
            e[i] = 1.0 if i == c else 0.0
            for j in range(n):
                K[i, j] = (1.0 if i == j else 0.0) - h * theta * J[i, j]
        if not solve_gauss(K, e):
            return False
        for i in range(n):
            W[i, c] = e[i]
    for i in range(n):
        for j in range(B.shape[1]):
            G[i, j] = 0.0
            for c in range(n):
                G[i, j] += h * W[i, c] * B[c, j]
    return True


@njit(cache=True, error_model="numpy")
def rows(C, D, G, E, theta, M, a, b):
    """Compute M <- D + (th I + (1 - th) E) C G and its row and column scales a, b."""
    m, n = C.shape
    col = np.empty(m)
    for j in range(m):
        for i in range(m):
            col[i] = 0.0
            for c in range(n):
                col[i] += C[i, c] * G[c, j]
        for i in range(m):
            M[i, j] = D[i, j] + theta * col[i]
            for k in range(m):
                M[i, j] += (1.0 - theta) * E[i, k] * col[k]
    one, other = scales(M)
    for i in range(m):
        a[i] = one[i]
        b[i] = other[i]


@njit(cache=True, error_model="numpy")
def offset(C, E, theta, x, z, q0, q1, u, v, r):
    """Compute the constant term r of a step's complementarity problem.

        r <- (1 - th) (C x + q0) + th (C z + q1) + E (1 - th) (C (z - x) + q1 - q0)

    u, v (m,): work.
    """
    times(C, x, u)
    times(C, z, v)
    for i in range(r.size):
        u[i] += q0[i]
        v[i] += q1[i]
        r[i] = (1.0 - theta) * u[i] + theta * v[i]
        u[i] = (1.0 - theta) * (v[i] - u[i])
    for i in range(r.size):
        for k in range(r.size):
            r[i] += E[i, k] * u[k]


@njit(cache=True, error_model="numpy")
def advance(f, linear, now, after, h, theta, x, y, v, q0, q1, system, state, lam, on, stale, count):
    """Advance one step from x to y; return a status.

    Newton's method on (y, lam), exact at once where f is linear. system: B, C, D, fixed; state: J,
    W, G, E, M, a, b, recomputed when `stale` and reused between steps. q0, q1 (m,): q at both ends.
    """
    B, C, D, fixed = system
    J, W, G, E, M, a, b = state
    n = x.size
    m = lam.size
    w = np.empty(m)
    r = np.empty(m)
    p = np.empty(m)
    s = np.empty(m)
    mid = np.empty(n)
    z = np.empty(n)
    old = np.zeros(n)
    for c in range(n):
        y[c] = x[c]
    if theta < 1.0:
        f(now, x.copy(), old)
        count[CALLS] += 1
    move = np.inf
    tries = 0
    fresh = False
    # Newton's method: the step linearised in y is an LCP in lam, solved by Lemke's method.
    for it in range(NEWTON):
        f(after, y.copy(), v)
        count[CALLS] += 1
        for c in range(n):
            v[c] = (1.0 - theta) * old[c] + theta * v[c] if theta < 1.0 else v[c]
        if state_code(v) != StepCode.OK:
            return state_code(v)
        if stale:
            if not linear:
                count[CALLS] += jacobian(f, after, y, J)
            if not matrices(J, h, theta, B, W, G):
                return StepCode.NEWTON_LIMIT
            rows(C, D, G, E, theta, M, a, b)
            stale = False
            fresh = True
        for c in range(n):
            mid[c] = x[c] + h * v[c] - y[c]
        times(W, mid, z)
        for c in range(n):
            z[c] += y[c]
        if m:
            offset(C, E, theta, x, z, q0, q1, p, s, r)
            found, pivots = solve(M, r, a, b, on, lam, w)
            count[LCPS] += 1
            count[PIVOTS] += pivots
            if not found:
                return StepCode.INFEASIBLE
            least_norm_solution(M, r, a, b, lam, w)
            times(G, lam, mid)
            for c in range(n):
                z[c] += mid[c]
        before = move
        move = 0.0
        for c in range(n):
            move = max(move, abs(z[c] - y[c]))
            y[c] = z[c]
        count[INNER] += 1
        if state_code(y) != StepCode.OK:
            return state_code(y)
        if (
            linear
            or move <= 1e-13 * (1.0 + largest(y))
            or (fresh and it > 5 and move <= 1e-11 * (1.0 + largest(y)))
        ):
            if theta == 1.0 or m == 0 or not regroup(D, fixed, lam, E):
                return StepCode.OK
            rows(C, D, G, E, theta, M, a, b)
            tries += 1
            if tries > AGAIN:
                count[UNSETTLED] += 1
                return StepCode.OK
        elif move > 0.1 * before:
            stale = True
        fresh = False
    return StepCode.NEWTON_LIMIT


@njit(cache=True, error_model="numpy")
def regroup(D, fixed, lam, E):
    """Set E to the projector of the rows with lam > 0; return whether it changed."""
    m = lam.size
    far = 0.0
    on = np.empty(m, np.bool_)
    for i in range(m):
        on[i] = lam[i] > 0.0
    new = at_end(D, fixed, on)
    for i in range(m):
        for j in range(m):
            far = max(far, abs(new[i, j] - E[i, j]))
    if far <= 1e-12:
        return False
    for i in range(m):
        for j in range(m):
            E[i, j] = new[i, j]
    return True


@njit(cache=True, error_model="numpy")
def march(f, q_of, moving, linear, J, t, substeps, x, q, B, C, D, theta, fixed, jumpy, check):
    """Integrate one run by theta steps.

    f(t, x, out), q_of(t, out): pointers; linear: f = J x + u(t). q (m,): its value if nothing
    moves. fixed (m,): rows without lam; jumpy (m,): rows their own multiplier does not move; check:
    search for other solutions of each step.

    Returns X (K, n), impulse (K, m), counters, status, time reached, and the time of the first step
    with several motions or NaN.
    """
    K = t.size
    n = x.size
    m = q.size
    X = np.full((K, n), np.nan)
    P = np.full((K, m), np.nan)
    x, y, v, q0, q1 = x.copy(), x.copy(), np.empty(n), q.copy(), q.copy()
    total = np.zeros(m)
    lam = np.zeros(m)
    on = np.zeros(m, np.bool_)
    w = np.empty(m)
    u = np.empty(m)
    z = np.empty(m)
    push = np.empty(n)
    free = np.empty(n)
    count = np.zeros(5, np.int64)
    twice = np.nan
    old = -1.0
    M = np.zeros((m, m))
    a = np.ones(m)
    b = np.ones(m)
    G = np.zeros((n, m))
    # D of the end of the step, in place
    D_end = at_end(D, fixed, on)
    state = (J.copy(), np.eye(n), G, D_end, M, a, b)
    for c in range(n):
        X[0, c] = x[c]
    for i in range(m):
        P[0, i] = 0.0
    # Theta steps, equally long between two samples.
    for k in range(K - 1):
        h = (t[k + 1] - t[k]) / substeps[k]
        for s in range(substeps[k]):
            now = t[k] + s * h
            after = t[k + 1] if s + 1 == substeps[k] else t[k] + (s + 1) * h
            if moving:
                q_of(now, q0)
                q_of(after, q1)
            stale = abs(h - old) > 1e-12 * h  # sample times are rounded: the same step for all
            old = h if stale else old
            code = advance(
                f,
                linear,
                now,
                after,
                h,
                theta,
                x,
                y,
                v,
                q0,
                q1,
                (B, C, D, fixed),
                state,
                lam,
                on,
                stale,
                count,
            )
            if code == StepCode.INFEASIBLE and state_code(q0) + state_code(q1) != StepCode.OK:
                code = StepCode.NAN
            if code != StepCode.OK:
                return X, P, count, code, now, twice
            if check and np.isnan(twice):
                times(G, lam, push)
                for c in range(n):
                    free[c] = y[c] - push[c]
                offset(C, D_end, theta, x, free, q0, q1, u, z, w)
                if has_other_motion(M, w, G, lam, h * largest(v) + largest(push)):
                    twice = now
            for i in range(m):
                if jumpy[i] and lam[i] * largest(G[:, i].copy()) > LARGE * h * largest(v):
                    return X, P, count, StepCode.JUMP, after, twice
                total[i] += h * lam[i]
            for c in range(n):
                x[c] = y[c]
        for c in range(n):
            X[k + 1, c] = x[c]
        for i in range(m):
            P[k + 1, i] = total[i]
    return X, P, count, StepCode.OK, t[K - 1], twice
