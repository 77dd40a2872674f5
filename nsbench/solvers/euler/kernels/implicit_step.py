"""Implicit Euler step in a given mode: Newton's method for state and signs of sliding surfaces.

Fields and switch functions are pointers (t, x, s, out) and (t, x, out). `mode` holds +1, -1 or 0
per surface: on the positive side, on the negative side, on the surface itself.
"""

from collections.abc import Callable

import numpy as np

from nsbench.compilation.decorators import inner_kernel
from nsbench.linalg.gauss_elimination import solve_gauss
from nsbench.linalg.max_norm import largest
from nsbench.solvers.common.kernels.step_code import StepCode, state_code

NEWTON = 30  # iterations; a fresh Jacobian needs about 5, a kept one three times that
ROUNDING = 64 * 2.0**-52  # what a few operations may lose, relative to the numbers in them


@inner_kernel
def copy(source: np.ndarray, target: np.ndarray) -> None:
    """Copy source (n,) into target (n,), element by element.

    The checks of an assignment of arrays take numba seconds to compile.
    """
    for i in range(target.size):
        target[i] = source[i]


@inner_kernel
def extended(
    field: Callable,
    blend: bool,
    t: float,
    x: np.ndarray,
    s: np.ndarray,
    e: np.ndarray,
    v: np.ndarray,
    out: np.ndarray,
) -> int:
    """Evaluate F(t, x, s), continued multilinearly to |s_i| > 1, in `out`; return the calls of F.

    The continuation is through the values at s_i = -1 and 1. Iterates of Newton's method leave the
    box, where a field need not mean anything. Nor need it between the modes: with `blend` it is
    multilinear there too, as Filippov's is. e (d,), v (n,): work.
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
    # Multilinear interpolation: sum over the 2^k corners of the signs that are continued.
    for code in range(2**k):
        weight = 1.0
        rest = code
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


@inner_kernel
def residual(
    field: Callable,
    switch: Callable,
    blend: bool,
    t: float,
    h: float,
    x: np.ndarray,
    y: np.ndarray,
    s: np.ndarray,
    slide: np.ndarray,
    e: np.ndarray,
    v: np.ndarray,
    c: np.ndarray,
    r: np.ndarray,
) -> int:
    """Compute the residual of an implicit step in r; return the calls of the field.

    r (n + p,): y - x - h F(t, y, s), then c_i(t, y) of the p sliding surfaces `slide`. e, v, c:
    work.
    """
    n = x.size
    calls = extended(field, blend, t, y, s, e, v, r[:n])
    for i in range(n):
        r[i] = y[i] - x[i] - h * r[i]
    if c.size:
        switch(t, y, c)
        for j in range(slide.size):
            r[n + j] = c[slide[j]]
    return calls


@inner_kernel
def difference(unit: float, size: float) -> float:
    """Return the step of a one-sided difference in a coordinate of this size.

    For functions that bend over the length `unit` or more: rounding is eps size / step of a
    derivative, curvature step / unit; both are at most sqrt(eps size / unit) where their product is
    least. Beyond 1e8 units the first decides: four digits of a derivative are enough for Newton's
    method.
    """
    return max(1.5e-8 * np.sqrt(unit * max(unit, size)), 1e-12 * size)


@inner_kernel
def jacobian(
    field: Callable,
    switch: Callable,
    blend: bool,
    unit: float,
    t: float,
    h: float,
    x: np.ndarray,
    y: np.ndarray,
    s: np.ndarray,
    slide: np.ndarray,
    e: np.ndarray,
    v: np.ndarray,
    c: np.ndarray,
    r: np.ndarray,
    q: np.ndarray,
    J: np.ndarray,
) -> int:
    """Compute the Jacobian J of the residual r in (y, s); return the calls of the field.

    One-sided differences in y; in s_i exact, as F is affine in each weight. x, y (n,), s (d,);
    slide (p,): the sliding surfaces; r (n + p,): the residual at y; e (d,), v (n,), c (d,),
    q (n + p,): work. J has n + p rows and columns.
    """
    n = x.size
    calls = 0
    # One-sided differences: one evaluation per column.
    for j in range(n):
        keep = y[j]
        y[j] = keep + difference(unit, abs(keep))
        calls += residual(field, switch, blend, t, h, x, y, s, slide, e, v, c, q)
        for i in range(r.size):
            J[i, j] = (q[i] - r[i]) / (y[j] - keep)
        y[j] = keep
    # The residual is affine in each weight: half the difference of its values at s_i = 1 and -1.
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


@inner_kernel
def newton(field, switch, blend, unit, t, h, x, mode, y, s, jump) -> tuple[bool, int, int]:
    """Solve one implicit step in a given mode by Newton's method from (y, s), which it overwrites.

    x, y (n,); mode, s (d,). jump (d,): overwritten by the displacement per unit of s_i. Returns
    converged, calls, iterations. The Jacobian is reused while an iteration gains a factor of 20.
    """
    n = x.size
    d = s.size
    size = n
    for i in range(d):
        size += mode[i] == 0
    slide = np.empty(size - n, np.int64)
    j = 0
    for i in range(d):
        if mode[i] == 0:
            slide[j] = i
            j = j + 1
    e = np.empty(d)
    v = np.empty(n)
    c = np.empty(d)
    r = np.empty(size)
    q = np.empty(size)
    J = np.zeros((size, size))
    K = np.empty((size, size))
    for i in range(d):
        if mode[i] != 0:
            s[i] = mode[i]
        elif abs(s[i]) > 1.0:
            s[i] = 0.0
    calls = 0
    last = 0.0
    # Simplified Newton iteration in (y, s): a new Jacobian only where convergence is slow.
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
        if not solve_gauss(K, q) or state_code(q) != StepCode.OK:
            return False, calls, it + 1
        for i in range(n):
            y[i] -= q[i]
        for j in range(slide.size):
            s[slide[j]] -= q[n + j]
            q[n + j] *= jump[slide[j]]
        move = largest(q)
        # far from the origin no more than rounding is allowed: a step may be much shorter than
        # 1e-12 of the coordinates
        if move <= 1e-12 * (unit + min(unit, largest(y))) + ROUNDING * largest(y):
            return True, calls, it + 1
        last = (
            move / before if it else 0.0
        )  # the next move is 20 times smaller or, fresh, its square
    return False, calls, NEWTON
