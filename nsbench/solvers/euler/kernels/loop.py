"""Time loops of explicit and implicit Euler for x' = F(t, x, s), s_i in Sgn(c_i(t, x)).

Fields and switch functions are pointers (t, x, s, out) and (t, x, out). `mode` holds +1, -1 or 0
per surface: on the positive side, on the negative side, on the surface itself.
"""

from collections.abc import Callable

import numpy as np

from nsbench.compilation.decorators import inner_kernel, njit
from nsbench.linalg.max_norm import largest
from nsbench.solvers.common.kernels.step_code import StepCode, state_code
from nsbench.solvers.euler.kernels.implicit_step import ROUNDING, copy, newton

SLIDES = (
    4 * 2.0**-52
)  # of the state: a slide may need so much more than a side gives; it adds up over steps
# a move so many times the last may be to a far solution: with few surfaces nearer ones count
SUDDEN = 10.0
FEW = 5
# modes and starts that one step may try: minutes, not for ever, with many surfaces
TRIALS = 100_000


@inner_kernel
def contradictions(
    switch: Callable,
    t: float,
    y: np.ndarray,
    mode: np.ndarray,
    c: np.ndarray,
    s: np.ndarray,
    jump: np.ndarray,
    new: np.ndarray,
    e: np.ndarray,
    noise: np.ndarray,
) -> bool:
    """Does the solved step contradict its mode?

    y (n,), s, c (d,): the solution and its switches; jump (d,): displacement per unit of s_i. new
    (d,) is overwritten by the mode with every contradiction turned over: a sign beyond +-1 leaves
    its surface, a switch of the wrong sign slides. A switch within the rounding of the state is no
    contradiction. e, noise (d,): work.
    """
    bad = False
    unsure = False
    size = largest(y)
    for i in range(mode.size):
        new[i] = mode[i]
        noise[i] = 0.0
        unsure |= mode[i] != 0 and not c[i] * mode[i] >= 0.0
    if unsure:  # what rounding of the state makes of c
        for j in range(y.size):
            keep = y[j]
            y[j] = keep + ROUNDING * keep
            switch(t, y, e)
            y[j] = keep
            for i in range(mode.size):
                noise[i] += abs(e[i] - c[i])
    for i in range(mode.size):
        if mode[i] == 0:
            if not (abs(s[i]) - 1.0) * jump[i] <= SLIDES * (size + jump[i]):
                new[i] = 1 if s[i] > 0.0 else -1
                bad = True
        elif not c[i] * mode[i] >= -noise[i]:
            new[i] = 0
            bad = True
    return bad


@inner_kernel
def implicit_step(field, switch, blend, unit, t, h, x, mode, y, s, last) -> tuple[bool, int, int]:
    """Solve one implicit step by block pivots from the last mode, else by trying all 3^d modes.

        x+ = x + h F(t, x+, s),   s_i in Sgn(c_i(t, x+))

    A solution exists for small h (Kakutani: s -> Sgn(c(y(s))) on the box); where fields are not
    affine in the signs Newton's method may need another start to find it, and all modes are tried
    from the 2^d points s_i = +-1/2 too. y (n,), s, mode (d,) are overwritten by the solution; last:
    displacement of the previous step. Returns (whether one was found, calls of the field, Newton
    iterations).
    """
    d = s.size
    calls = 0
    inner = 0
    new = mode.copy()
    c = np.empty(d)
    jump = np.zeros(d)
    start = s.copy()
    e = np.empty(d)
    noise = np.empty(d)
    # Block principal pivoting on the mode; after 2 d + 2 trials, enumeration of all 3^d modes.
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
        calls = calls + more
        inner = inner + its
        if solved:
            if d:
                switch(t, y, c)
            if not contradictions(switch, t, y, mode, c, s, jump, new, e, noise):
                for i in range(d):
                    s[i] = min(1.0, max(-1.0, s[i]))
                if d == 0 or d > FEW or distance(x, y) <= SUDDEN * last:
                    return True, calls, inner
                more, its = nearest_solution(
                    field, switch, blend, unit, t, h, x, mode, y, s, start, c, jump, new, e, noise
                )
                return True, calls + more, inner + its
        else:
            copy(x, y)
            copy(start, s)
            for i in range(d):
                new[i] = 0 if mode[i] != 0 else new[i]
    return False, calls, inner


@inner_kernel
def distance(x: np.ndarray, y: np.ndarray) -> float:
    """Return the largest difference of the coordinates of x and y (n,)."""
    out = 0.0
    for i in range(x.size):
        out = max(out, abs(y[i] - x[i]))
    return out


@inner_kernel
def nearest_solution(
    field: Callable,
    switch: Callable,
    blend: bool,
    unit: float,
    t: float,
    h: float,
    x: np.ndarray,
    mode: np.ndarray,
    y: np.ndarray,
    s: np.ndarray,
    start: np.ndarray,
    c: np.ndarray,
    jump: np.ndarray,
    new: np.ndarray,
    e: np.ndarray,
    noise: np.ndarray,
) -> tuple[int, int]:
    """Replace the solution (mode, y, s) of a step by the one nearest to x among all 3^d modes.

    Where fields are stiff beyond a surface a step has solutions there, however far it is, until h
    is below distance / speed. start (d,): signs from which Newton's method starts; c, jump, new, e,
    noise: work. Returns (calls of the field, Newton iterations).
    """
    d = s.size
    calls = 0
    inner = 0
    best = distance(x, y)
    to = y.copy()
    weights = s.copy()
    at = mode.copy()
    # Enumeration of the modes; codes are numbers of base 3.
    for code in range(3**d):
        for i in range(d):
            mode[i] = code % 3 - 1
            code //= 3
        copy(x, y)
        copy(start, s)
        solved, more, its = newton(field, switch, blend, unit, t, h, x, mode, y, s, jump)
        calls = calls + more
        inner = inner + its
        if solved and distance(x, y) < best:
            switch(t, y, c)
            if not contradictions(switch, t, y, mode, c, s, jump, new, e, noise):
                best = distance(x, y)
                copy(y, to)
                copy(mode, at)
                for i in range(d):
                    weights[i] = min(1.0, max(-1.0, s[i]))
    copy(to, y)
    copy(weights, s)
    copy(at, mode)
    return calls, inner


@inner_kernel
def keep_intermediate(
    rows: np.ndarray, j: int, steps: int, t: float, x: np.ndarray, w: np.ndarray
) -> None:
    """Record time, state and integrals in `rows` where step j ends a part of its interval.

    rows (parts, k), k = 1 + n + d; x (n,), w (d,). The interval has `steps` steps. Not for the last
    part, whose end is the sample.
    """
    part = (j + 1) * rows.shape[0] // steps
    if j * rows.shape[0] // steps < part < rows.shape[0]:
        rows[part, 0] = t
        for i in range(x.size):
            rows[part, 1 + i] = x[i]
        for i in range(w.size):
            rows[part, 1 + x.size + i] = w[i]


@njit(cache=True)
def implicit_euler(field, switch, blend, unit, t, substeps, x, d, parts) -> tuple:
    """Integrate by implicit Euler steps, equally long between two samples.

    t (K,), substeps (K - 1,); x (n,): the start; parts: of each interval, at whose ends states are
    recorded; unit: size of the state that tolerances are relative to. Returns X (K, n), integrals
    of theta (K, d), calls, iterations, status, time reached, and the records (K - 1, parts, 1 + n +
    d): time, state and integrals, NaN where no step ends.
    """
    K = t.size
    x = x.copy()
    between = np.full((K - 1, parts, 1 + x.size + d), np.nan)
    X = np.full((K, x.size), np.nan)
    W = np.full((K, d), np.nan)
    y = x.copy()
    s = np.zeros(d)
    c = np.zeros(d)
    w = np.zeros(d)
    mode = np.zeros(d, np.int64)
    if d:
        switch(t[0], x, c)
        for i in range(d):
            mode[i] = np.int64(np.sign(c[i]))
    copy(x, X[0])
    copy(w, W[0])
    calls = 0
    inner = 0
    last = np.inf
    for k in range(K - 1):
        h = (t[k + 1] - t[k]) / substeps[k]
        for j in range(substeps[k]):
            after = t[k + 1] if j + 1 == substeps[k] else t[k] + (j + 1) * h
            found, more, its = implicit_step(
                field, switch, blend, unit, after, h, x, mode, y, s, last
            )
            calls = calls + more
            inner = inner + its
            if not found or state_code(y) != StepCode.OK:
                if not found:  # a field that is no number on the way explains it
                    field(after - h, x, s, y)
                    for i in range(x.size):
                        x[i] += h * y[i]
                    field(after, x, s, y)
                bad = state_code(y)
                return (
                    X,
                    W,
                    calls,
                    inner,
                    (StepCode.UNSOLVED if bad == StepCode.OK else bad),
                    after - h,
                    between,
                )
            last = distance(x, y)
            copy(y, x)
            for i in range(d):
                w[i] += h * 0.5 * (1.0 + s[i])
            keep_intermediate(between[k], j, substeps[k], after, x, w)
        copy(x, X[k + 1])
        copy(w, W[k + 1])
    return X, W, calls, inner, StepCode.OK, t[K - 1], between


@njit(cache=True)
def explicit_euler(
    field: Callable,
    switch: Callable,
    t: np.ndarray,
    substeps: np.ndarray,
    x: np.ndarray,
    d: int,
    parts: int,
) -> tuple:
    """Integrate by explicit Euler, with s_i = 1 where c_i >= 0, else -1.

    t (K,), substeps (k,), k = K - 1; x (n,): the start. Arguments and returned values as for
    implicit_euler; there are no Newton iterations.
    """
    K = t.size
    x = x.copy()
    X = np.full((K, x.size), np.nan)
    W = np.full((K, d), np.nan)
    v = np.empty(x.size)
    s = np.empty(d)
    c = np.zeros(d)
    w = np.zeros(d)
    between = np.full((K - 1, parts, 1 + x.size + d), np.nan)
    copy(x, X[0])
    copy(w, W[0])
    calls = 0
    # Explicit Euler with equal steps between two samples.
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
            bad = state_code(x)
            if bad == StepCode.OK:
                bad = state_code(c)
            if bad != StepCode.OK:
                return X, W, calls, 0, bad, now, between
            keep_intermediate(between[k], j, substeps[k], now + h, x, w)
        copy(x, X[k + 1])
        copy(w, W[k + 1])
    return X, W, calls, 0, StepCode.OK, t[K - 1], between
