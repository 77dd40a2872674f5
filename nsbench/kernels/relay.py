"""Explicit and implicit Euler on a field with signs, x' = F(t, x, s), s_i in Sgn(c_i(t, x)): the time loops.

Fields and switch functions are pointers (t, x, s, out) and (t, x, out). `mode` holds +1, -1 or 0 per surface:
on the positive side, on the negative side, on the surface itself.
"""
import numpy as np
from numba import njit

from nsbench.kernels.dense import BLOWN, NAN, OK, gauss, health, largest  # noqa: F401 (codes that solvers read here)

STUCK = 3                         # beside OK, NAN, BLOWN
NEWTON = 30                       # iterations; a fresh Jacobian needs about 5, a kept one three times that
SUDDEN, FEW = 10.0, 5             # a move so many times the last may be to a far solution: with few surfaces nearer ones count
TRIALS = 100_000                  # modes and starts that one step may try: minutes, not for ever, with many surfaces
ROUNDING = 64 * 2.0**-52          # what a few operations may lose, relative to the numbers in them

# only called by kernels of this file: without the wrappers for Python they compile faster, and crash if Python calls them
inner = njit(cache=True, no_cpython_wrapper=True, no_cfunc_wrapper=True)


@inner
def copy(source, target):
    """target <- source; a loop, as the checks of an assignment of arrays take numba seconds to compile."""
    for i in range(target.size):
        target[i] = source[i]


@inner
def extended(field, blend, t, x, s, e, v, out):
    """F(t, x, s) in `out`, continued multilinearly to |s_i| > 1 through the values at s_i = -1 and 1; calls made.

    Iterates of Newton's method leave the box, where a field need not mean anything. Nor need it between the modes: with
    `blend` it is multilinear there too, as Filippov's is. e (d,), v (n,): work.
    """
    k = 0
    for i in range(s.size):
        if abs(s[i]) > 1.0 or (blend and abs(s[i]) < 1.0):
            k += 1
    if k == 0:
        field(t, x, s, out)
        return 1
    for c in range(out.size):
        out[c] = 0.0
    for code in range(2**k):
        weight, rest = 1.0, code
        for i in range(s.size):
            e[i] = s[i]
            if abs(s[i]) > 1.0 or (blend and abs(s[i]) < 1.0):
                e[i] = 1.0 if rest % 2 == 0 else -1.0
                weight *= 0.5 * (1.0 + e[i] * s[i])
                rest //= 2
        field(t, x, e, v)
        for c in range(out.size):
            out[c] += weight * v[c]
    return 2**k


@inner
def residual(field, switch, blend, t, h, x, y, s, slide, e, v, c, r):
    """y - x - h F(t, y, s) and c_i(t, y) of the sliding surfaces, in r; calls made."""
    n = x.size
    calls = extended(field, blend, t, y, s, e, v, r[:n])
    for i in range(n):
        r[i] = y[i] - x[i] - h * r[i]
    if c.size:
        switch(t, y, c)
        for j in range(slide.size):
            r[n + j] = c[slide[j]]
    return calls


@inner
def jacobian(field, switch, blend, unit, t, h, x, y, s, slide, e, v, c, r, q, J):
    """Derivative of the residual r: one-sided differences in y; in s_i exact, as F is affine in each weight."""
    n, calls = x.size, 0
    for j in range(n):
        keep = y[j]
        y[j] = keep + 1.5e-8 * max(unit, abs(keep))          # sqrt(eps): half of the digits, enough for Newton
        calls += residual(field, switch, blend, t, h, x, y, s, slide, e, v, c, q)
        for i in range(r.size):
            J[i, j] = (q[i] - r[i]) / (y[j] - keep)
        y[j] = keep
    for j in range(slide.size):
        keep = s[slide[j]]
        s[slide[j]] = 1.0
        calls += residual(field, switch, blend, t, h, x, y, s, slide, e, v, c, q)
        for i in range(n):
            J[i, n + j] = 0.5 * q[i]
        s[slide[j]] = -1.0
        calls += residual(field, switch, blend, t, h, x, y, s, slide, e, v, c, q)
        for i in range(n):
            J[i, n + j] -= 0.5 * q[i]
        s[slide[j]] = keep
        for i in range(n, n + slide.size):
            J[i, n + j] = 0.0
    return calls


@inner
def newton(field, switch, blend, unit, t, h, x, mode, y, s, jump):
    """Solve one implicit step for a given mode, from (y, s), which are overwritten.

    jump (d,): displacement per unit of s_i, the size of a step's freedom on surface i. Returns converged, calls,
    iterations. The Jacobian is kept while an iteration gains a factor of 20.
    """
    n, d = x.size, s.size
    size = n
    for i in range(d):
        size += mode[i] == 0
    slide, j = np.empty(size - n, np.int64), 0
    for i in range(d):
        if mode[i] == 0:
            slide[j], j = i, j + 1
    e, v, c = np.empty(d), np.empty(n), np.empty(d)
    r, q, J, K = np.empty(size), np.empty(size), np.zeros((size, size)), np.empty((size, size))
    for i in range(d):
        if mode[i] != 0:
            s[i] = mode[i]
        elif abs(s[i]) > 1.0:
            s[i] = 0.0
    calls, last = 0, 0.0
    for it in range(NEWTON):
        calls += residual(field, switch, blend, t, h, x, y, s, slide, e, v, c, r)
        if it == 0 or last > 0.05:
            calls += jacobian(field, switch, blend, unit, t, h, x, y, s, slide, e, v, c, r, q, J)
            for j in range(slide.size):
                jump[slide[j]] = 0.0
                for i in range(n):
                    jump[slide[j]] = max(jump[slide[j]], abs(J[i, n + j]))
        before = largest(q) if it else np.inf
        copy(r, q)
        for i in range(size):
            copy(J[i], K[i])
        if not gauss(K, q) or health(q) != OK:
            return False, calls, it + 1
        for i in range(n):
            y[i] -= q[i]
        for j in range(slide.size):
            s[slide[j]] -= q[n + j]
            q[n + j] *= jump[slide[j]]
        move = largest(q)
        # far from the origin no more than rounding is allowed: a step may be much shorter than 1e-12 of the coordinates
        if move <= 1e-12 * (unit + min(unit, largest(y))) + ROUNDING * largest(y):
            return True, calls, it + 1
        last = move / before if it else 0.0                 # the next move is 20 times smaller or, fresh, its square
    return False, calls, NEWTON


@inner
def wrong(switch, t, y, mode, c, s, jump, new, e, noise):
    """Whether the solved step contradicts its mode; `new` gets the mode with every contradiction turned over.

    e, noise (d,): work.
    """
    bad, unsure, size = False, False, largest(y)
    for i in range(mode.size):
        new[i], noise[i] = mode[i], 0.0
        unsure |= mode[i] != 0 and not c[i] * mode[i] >= 0.0
    if unsure:                                              # what rounding of the state makes of c
        for j in range(y.size):
            keep = y[j]
            y[j] = keep + ROUNDING * keep
            switch(t, y, e)
            y[j] = keep
            for i in range(mode.size):
                noise[i] += abs(e[i] - c[i])
    for i in range(mode.size):
        if mode[i] == 0:
            if not (abs(s[i]) - 1.0) * jump[i] <= ROUNDING * (size + jump[i]):
                new[i], bad = (1 if s[i] > 0.0 else -1), True
        elif not c[i] * mode[i] >= -noise[i]:
            new[i], bad = 0, True
    return bad


@inner
def implicit_step(field, switch, blend, unit, t, h, x, mode, y, s, last):
    """x+ = x + h F(t, x+, s), s_i in Sgn(c_i(t, x+)): from the last mode by block pivots, else by trying all 3^d.

    A solution exists for small h (Kakutani: s -> Sgn(c(y(s))) on the box); where fields are not affine in the signs
    Newton's method may need another start to find it, and all modes are tried from the 2^d points s_i = +-1/2 too.
    y, s, mode are overwritten by the solution; last: how far the step before went. Returns found, calls, iterations.
    """
    d, calls, inner = s.size, 0, 0
    new, c, jump, start = mode.copy(), np.empty(d), np.zeros(d), s.copy()
    e, noise = np.empty(d), np.empty(d)
    for trial in range(min(2 * d + 2 + 3**d * (1 + 2**d), TRIALS)):
        if trial >= 2 * d + 2:
            code = trial - 2 * d - 2
            again = code // 3**d
            for i in range(d):
                new[i] = code % 3 - 1
                code //= 3
            copy(start, s)
            for i in range(d):
                if again > 0:
                    s[i] = 0.5 if ((again - 1) >> i) % 2 == 0 else -0.5
            copy(x, y)
        copy(new, mode)
        solved, more, its = newton(field, switch, blend, unit, t, h, x, mode, y, s, jump)
        calls, inner = calls + more, inner + its
        if solved:
            if d:
                switch(t, y, c)
            if not wrong(switch, t, y, mode, c, s, jump, new, e, noise):
                for i in range(d):
                    s[i] = min(1.0, max(-1.0, s[i]))
                if d == 0 or d > FEW or distance(x, y) <= SUDDEN * last:
                    return True, calls, inner
                more, its = nearest(field, switch, blend, unit, t, h, x, mode, y, s, start, c, jump, new, e, noise)
                return True, calls + more, inner + its
        else:
            copy(x, y)
            copy(start, s)
            for i in range(d):
                new[i] = 0 if mode[i] != 0 else new[i]
    return False, calls, inner


@inner
def distance(x, y):
    """Largest difference of the coordinates."""
    out = 0.0
    for i in range(x.size):
        out = max(out, abs(y[i] - x[i]))
    return out


@inner
def nearest(field, switch, blend, unit, t, h, x, mode, y, s, start, c, jump, new, e, noise):
    """Of the solutions of a step in all 3^d modes the one nearest to x: (mode, y, s), one of them, become that one.

    Where fields are stiff beyond a surface a step has solutions there, however far it is, until h is below distance / speed.
    Returns calls, iterations.
    """
    d, calls, inner = s.size, 0, 0
    best, to, weights, at = distance(x, y), y.copy(), s.copy(), mode.copy()
    for code in range(3**d):
        for i in range(d):
            mode[i] = code % 3 - 1
            code //= 3
        copy(x, y)
        copy(start, s)
        solved, more, its = newton(field, switch, blend, unit, t, h, x, mode, y, s, jump)
        calls, inner = calls + more, inner + its
        if solved and distance(x, y) < best:
            switch(t, y, c)
            if not wrong(switch, t, y, mode, c, s, jump, new, e, noise):
                best = distance(x, y)
                copy(y, to)
                copy(mode, at)
                for i in range(d):
                    weights[i] = min(1.0, max(-1.0, s[i]))
    copy(to, y)
    copy(weights, s)
    copy(at, mode)
    return calls, inner


@njit(cache=True)
def march_implicit(field, switch, blend, unit, t, substeps, x, d):
    """Samples of one run of implicit Euler: X (K, n), integrals of theta (K, d), calls, iterations, status, time.

    unit: size of the state that tolerances are relative to.
    """
    K, x = t.size, x.copy()
    X, W = np.full((K, x.size), np.nan), np.full((K, d), np.nan)
    y, s, c, w = x.copy(), np.zeros(d), np.zeros(d), np.zeros(d)
    mode = np.zeros(d, np.int64)
    if d:
        switch(t[0], x, c)
        for i in range(d):
            mode[i] = np.int64(np.sign(c[i]))
    copy(x, X[0])
    copy(w, W[0])
    calls, inner, last = 0, 0, np.inf
    for k in range(K - 1):
        h = (t[k + 1] - t[k]) / substeps[k]
        for j in range(substeps[k]):
            after = t[k + 1] if j + 1 == substeps[k] else t[k] + (j + 1) * h
            found, more, its = implicit_step(field, switch, blend, unit, after, h, x, mode, y, s, last)
            calls, inner = calls + more, inner + its
            if not found or health(y) != OK:
                if not found:                               # a field that is no number on the way explains it
                    field(after - h, x, s, y)
                    for i in range(x.size):
                        x[i] += h * y[i]
                    field(after, x, s, y)
                bad = health(y)
                return X, W, calls, inner, (STUCK if bad == OK else bad), after - h
            last = distance(x, y)
            copy(y, x)
            for i in range(d):
                w[i] += h * 0.5 * (1.0 + s[i])
        copy(x, X[k + 1])
        copy(w, W[k + 1])
    return X, W, calls, inner, OK, t[K - 1]


@njit(cache=True)
def march_explicit(field, switch, t, substeps, x, d):
    """Samples of one run of explicit Euler, with s_i = 1 where c_i >= 0, else -1; returns as march_implicit does."""
    K, x = t.size, x.copy()
    X, W = np.full((K, x.size), np.nan), np.full((K, d), np.nan)
    v, s, c, w = np.empty(x.size), np.empty(d), np.zeros(d), np.zeros(d)
    copy(x, X[0])
    copy(w, W[0])
    calls = 0
    for k in range(K - 1):
        h = (t[k + 1] - t[k]) / substeps[k]
        for j in range(substeps[k]):
            now = t[k] + j * h
            if d:
                switch(now, x, c)
            for i in range(d):
                s[i] = 1.0 if c[i] >= 0.0 else -1.0
                w[i] += h if c[i] >= 0.0 else 0.0
            field(now, x, s, v)
            calls += 1
            for i in range(x.size):
                x[i] += h * v[i]
            bad = health(x)
            if bad == OK:
                bad = health(c)
            if bad != OK:
                return X, W, calls, 0, bad, now
        copy(x, X[k + 1])
        copy(w, W[k + 1])
    return X, W, calls, 0, OK, t[K - 1]
