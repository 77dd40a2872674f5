"""Time loop of implicit theta stepping: one linear complementarity problem per step.

    x+ = x + h ((1 - th) f(t, x) + th f(t + h, x+) + B lam)
    0 <= lam _|_ D lam + (1 - th) v + th v+ + E (1 - th) (v+ - v) >= 0
    v = C x + q(t),   v+ = C x+ + q(t + h)

E picks the rows that constrain the state alone; these hold at the end of the step. Held at the mean
they would let the state swing about the constraint for ever (th = 1/2). The other rows determine
lam, so they belong to the time that lam belongs to. E is the projector on the left null space of
D_II, I the rows with lam > 0: found by repeating the step at most 3 times.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from nsbench.compilation.borrowed_arrays import borrowed
from nsbench.compilation.decorators import inlined, inner_kernel, njit
from nsbench.lcp.lemke import has_other_motion, least_norm_solution, solve
from nsbench.linalg.max_norm import largest
from nsbench.solvers.common.kernels.step_code import StepCode, state_code
from nsbench.solvers.theta.kernels.step_matrices import (
    ComplementaritySystem,
    StepMatrices,
    matrices,
    offset,
    rows,
    times,
)

NEWTON = 50  # iterations; the matrix is made anew when one gains less than a factor of ten
AGAIN = 3  # repetitions of a step whose rows changed their kind
LARGE = 10.0  # times the way of the drift: pushes beyond are jumps of the state
LCPS, PIVOTS, INNER, CALLS, UNSETTLED = range(5)


class Step(NamedTuple):
    """State of a step, overwritten by the next one.

    x, y (n,): state at both ends; v (n,): the drift between them, as in theta stepping; q0, q1
    (m,): q at both ends; lam (m,): multipliers; on (m,): rows in the basis of the LCP.
    """

    x: np.ndarray
    y: np.ndarray
    v: np.ndarray
    q0: np.ndarray
    q1: np.ndarray
    lam: np.ndarray
    on: np.ndarray


class Workspace(NamedTuple):
    """Work arrays: r, w, p, s (m,); z, mid, old (n,). old: the drift at the start of a step."""

    r: np.ndarray
    w: np.ndarray
    p: np.ndarray
    s: np.ndarray
    z: np.ndarray
    mid: np.ndarray
    old: np.ndarray


@inner_kernel
def workspace(n, m):
    """Allocate a Workspace."""
    return Workspace(
        np.empty(m),
        np.empty(m),
        np.empty(m),
        np.empty(m),
        np.empty(n),
        np.empty(n),
        np.zeros(n),
    )


@inner_kernel
def copied(x, out):
    """Copy x into out, and return out: a function of the case gets no array of the loop."""
    for c in range(x.size):
        out[c] = x[c]
    return out


@inner_kernel
def at_end(D: np.ndarray, fixed: np.ndarray, on: np.ndarray) -> np.ndarray:
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


@inner_kernel
def jacobian(f: Callable, t: float, x: np.ndarray, J: np.ndarray) -> int:
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


@inner_kernel
def linearise(f, linear, after, h, theta, y, system, matrix, count):
    """Compute the StepMatrices anew at y; return False if I - h th J is singular."""
    J, W, G, E, M, a, b = matrix
    if not linear:
        count[CALLS] += jacobian(f, after, y, J)
    if not matrices(J, h, theta, system.B, W, G):
        return False
    rows(system.C, system.D, G, E, theta, M, a, b)
    return True


@inlined
def push_out(theta, step, system, matrix, work, count):
    """Solve the complementarity problem of a step for lam and add the push G lam to work.z.

    work.z (n,): the end of the step without lam. Returns False if there is no solution.
    """
    x, _, _, q0, q1, lam, on = step
    _, _, G, E, M, a, b = matrix
    r, w, p, s, z, mid, _ = work
    offset(system.C, E, theta, x, z, q0, q1, p, s, r)
    found, pivots = solve(M, r, a, b, on, lam, w)
    count[LCPS] += 1
    count[PIVOTS] += pivots
    if not found:
        return False
    least_norm_solution(M, r, a, b, lam, w)
    times(G, lam, mid)
    for c in range(z.size):
        z[c] += mid[c]
    return True


@inner_kernel
def advance(f, linear, now, after, h, theta, step, system, matrix, work, stale, count):
    """Advance one step from step.x to step.y; return a StepCode.

    Newton's method on (y, lam), exact at once where f is linear. matrix: StepMatrices, computed
    anew when `stale`.
    """
    step, system, matrix, work = borrowed((step, system, matrix, work))
    x, y, v, _, _, lam, _ = step
    n = x.size
    m = lam.size
    z = work.z
    mid = work.mid
    old = work.old
    for c in range(n):
        y[c] = x[c]
    if theta < 1.0:
        f(now, copied(x, mid), old)
        count[CALLS] += 1
    move = np.inf
    tries = 0
    fresh = False
    # Newton's method: the step linearised in y is an LCP in lam, solved by Lemke's method.
    for it in range(NEWTON):
        f(after, copied(y, mid), v)
        count[CALLS] += 1
        for c in range(n):
            v[c] = (1.0 - theta) * old[c] + theta * v[c] if theta < 1.0 else v[c]
        if state_code(v) != StepCode.OK:
            return state_code(v)
        if stale:
            if not linearise(f, linear, after, h, theta, y, system, matrix, count):
                return StepCode.NEWTON_LIMIT
            stale = False
            fresh = True
        for c in range(n):
            mid[c] = x[c] + h * v[c] - y[c]
        times(matrix.W, mid, z)
        for c in range(n):
            z[c] += y[c]
        if m and not push_out(theta, step, system, matrix, work, count):
            return StepCode.INFEASIBLE
        before = move
        move = 0.0
        for c in range(n):
            move = max(move, abs(z[c] - y[c]))
            y[c] = z[c]
        count[INNER] += 1
        if state_code(y) != StepCode.OK:
            return state_code(y)
        if linear or has_converged(move, fresh and it > 5, y):
            if theta == 1.0 or m == 0 or not regroup(system, theta, lam, matrix):
                return StepCode.OK
            tries += 1
            if tries > AGAIN:
                count[UNSETTLED] += 1
                return StepCode.OK
        elif move > 0.1 * before:
            stale = True
        fresh = False
    return StepCode.NEWTON_LIMIT


@inner_kernel
def has_converged(move, slowly, y):
    """Return whether an iteration of Newton's method moved y by rounding alone.

    slowly: after many iterations, the last one with new matrices, rounding may be larger.
    """
    return move <= 1e-13 * (1.0 + largest(y)) or (slowly and move <= 1e-11 * (1.0 + largest(y)))


@inner_kernel
def regroup(system, theta, lam, matrix):
    """Set E to the projector of the rows with lam > 0; return whether it changed, and M with it."""
    E = matrix.E
    m = lam.size
    far = 0.0
    on = np.empty(m, np.bool_)
    for i in range(m):
        on[i] = lam[i] > 0.0
    new = at_end(system.D, system.fixed, on)
    for i in range(m):
        for j in range(m):
            far = max(far, abs(new[i, j] - E[i, j]))
    if far <= 1e-12:
        return False
    for i in range(m):
        for j in range(m):
            E[i, j] = new[i, j]
    rows(system.C, system.D, matrix.G, E, theta, matrix.M, matrix.a, matrix.b)
    return True


@inner_kernel
def has_finite_inputs(step):
    """Return whether q is finite at both ends of the step."""
    return state_code(step.q0) + state_code(step.q1) == StepCode.OK


@inner_kernel
def has_second_motion(h, theta, step, system, matrix, work):
    """Return whether the complementarity problem of the step just done has another solution, with
    another motion."""
    push = work.mid
    free = work.z
    times(matrix.G, step.lam, push)
    for c in range(push.size):
        free[c] = step.y[c] - push[c]
    offset(system.C, matrix.E, theta, step.x, free, step.q0, step.q1, work.p, work.s, work.w)
    reach = h * largest(step.v) + largest(push)
    return has_other_motion(matrix.M, work.w, matrix.G, step.lam, reach)


@inner_kernel
def has_jump(h, step, matrix, jumpy):
    """Return whether a row that its own multiplier does not move pushes farther than the drift."""
    lam = step.lam
    v = step.v
    G = matrix.G
    for i in range(jumpy.size):
        if jumpy[i] and lam[i] * largest(G[:, i].copy()) > LARGE * h * largest(v):
            return True
    return False


@njit(cache=True, error_model="numpy")
def march(f, q_of, moving, linear, J, t, substeps, x, q, B, C, D, theta, fixed, jumpy, check):
    """Integrate one run by theta steps.

    f(t, x, out), q_of(t, out): pointers; linear: f = J x + u(t). q (m,): its value if nothing
    moves. fixed (m,): rows without lam; jumpy (m,): rows their own multiplier does not move; check:
    search for other solutions of each step.
    Returns X (K, n), impulse (K, m), counters, status, time reached, and the time of the first step
    with several motions or NaN.
    """
    n = x.size
    m = q.size
    X = np.full((t.size, n), np.nan)
    P = np.full((t.size, m), np.nan)
    on = np.zeros(m, np.bool_)
    x = x.copy()
    step = Step(x, x.copy(), np.empty(n), q.copy(), q.copy(), np.zeros(m), on)
    system = ComplementaritySystem(B, C, D, fixed)
    E = at_end(D, fixed, on)
    G = np.zeros((n, m))
    matrix = StepMatrices(J.copy(), np.eye(n), G, E, np.zeros((m, m)), np.ones(m), np.ones(m))
    # Arrays of a tuple are bound once: taken from it in a loop, their reference counts cost time.
    y = step.y
    lam = step.lam
    work = workspace(n, m)
    total = np.zeros(m)
    count = np.zeros(5, np.int64)
    twice = np.nan
    old = -1.0
    X[0] = x
    P[0] = 0.0
    # Theta steps, equally long between two samples.
    for k in range(t.size - 1):
        h = (t[k + 1] - t[k]) / substeps[k]
        for s in range(substeps[k]):
            now = t[k] + s * h
            after = t[k + 1] if s + 1 == substeps[k] else t[k] + (s + 1) * h
            if moving:
                q_of(now, step.q0)
                q_of(after, step.q1)
            stale = abs(h - old) > 1e-12 * h  # sample times are rounded: the same step for all
            old = h if stale else old
            code = advance(
                f, linear, now, after, h, theta, step, system, matrix, work, stale, count
            )
            if code == StepCode.INFEASIBLE and not has_finite_inputs(step):
                code = StepCode.NAN
            if code != StepCode.OK:
                return X, P, count, code, now, twice
            if check and has_second_motion(h, theta, step, system, matrix, work):
                twice = now
                check = False  # the first such step is enough
            if has_jump(h, step, matrix, jumpy):
                return X, P, count, StepCode.JUMP, after, twice
            for i in range(m):
                total[i] += h * lam[i]
            for c in range(n):
                x[c] = y[c]
        X[k + 1] = x
        P[k + 1] = total
    return X, P, count, StepCode.OK, t[-1], twice
