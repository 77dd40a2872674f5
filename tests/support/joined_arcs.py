"""Cases whose solutions are joined from smooth arcs that are solved with 28 digits.

The arcs are integrated by extrapolation (Gragg, Bulirsch, Stoer) in mpmath and end where a watched
function falls through zero: a switch, a gap, a multiplier, the weight of a sliding motion beyond
one. It shares nothing with the methods of the package but the functions of the cases, which are
evaluated with 28 digits too. Surfaces are met one at a time.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations

import mpmath as mp
import numpy as np

from nsbench import LCS, Affine, Case, Complementarity, Filippov

DIGITS = 28
STEP = 1 / 16  # of an arc; sign changes of watched functions are looked for at its ends
LEVELS = 13  # of the extrapolation: order 26
JUST_MET = 1e-18  # of a watched function: it is zero here but for rounding


class Mp:
    """mpmath as the array namespace of a case: a vector is a list."""

    cos, sin, exp = mp.cos, mp.sin, mp.exp
    stack = staticmethod(list)
    array = staticmethod(list)


@dataclass
class Path:
    """What an arc is made of: rhs(t, x), watched(t, x) >= 0, and what follows when one is not.

    rhs and watched are of the present arc; ended(t, x, k) changes them when watched[k] is zero.
    """

    rhs: Callable
    watched: Callable
    ended: Callable


@dataclass(frozen=True)
class ArcCase:
    """A case, and the path that joins its arcs."""

    case: Case
    path: Callable[[], Path]

    def truth(self) -> np.ndarray:
        """Return the states (k, n) at the sample times of the case."""
        with mp.workdps(DIGITS):
            path = self.path()
            x = [mp.mpf(float(v)) for v in self.case.x0]
            times = [mp.mpf(float(t)) for t in self.case.t]
            out = [x]
            for t, end in zip(times[:-1], times[1:], strict=True):
                x = _until(path, t, x, end)
                out.append(x)
            return np.array([[float(v) for v in x] for x in out])


def _until(path: Path, t, x, end):
    """Return x(end) from x at t, over all ends of arcs between."""
    while t < end:
        h = min(mp.mpf(STEP), end - t)
        new = _extrapolated(path.rhs, t, x, h)
        fallen = [k for k, v in enumerate(path.watched(t + h, new)) if v < -JUST_MET]
        if not fallen:
            t, x = t + h, new
            continue
        part, k = min((_root(path, t, x, h, k), k) for k in fallen)
        x = _extrapolated(path.rhs, t, x, part)
        t = t + part
        path.ended(t, x, k)
    return x


def _root(path: Path, t, x, h, k):
    """Return the part of h after which watched[k] is zero (Illinois)."""

    def value(s):
        return path.watched(t + s, _extrapolated(path.rhs, t, x, s))[k]

    if value(h * mp.mpf(2) ** -40) < 0:
        raise ArithmeticError(f"watched function {k} is negative from t = {t} on")
    return mp.findroot(value, (h * mp.mpf(2) ** -40, h), solver="anderson", tol=1e-48)


def _extrapolated(f, t, x, h):
    """Return x(t + h) of x' = f(t, x) by the modified midpoint rule, extrapolated in h^2."""
    if h == 0:
        return x
    counts = [2 * (j + 1) for j in range(LEVELS)]
    table = [_midpoint(f, t, x, h, n) for n in counts]
    for j in range(1, LEVELS):
        for i in range(LEVELS - 1, j - 1, -1):
            ratio = (mp.mpf(counts[i]) / counts[i - j]) ** 2 - 1
            table[i] = [a + (a - b) / ratio for a, b in zip(table[i], table[i - 1], strict=True)]
    return table[-1]


def _midpoint(f, t, x, h, n):
    """Return the modified midpoint rule of n steps, smoothed."""
    s = h / n
    before = x
    now = [a + s * b for a, b in zip(x, f(t, x), strict=True)]
    for j in range(1, n):
        v = f(t + j * s, now)
        before, now = now, [a + 2 * s * b for a, b in zip(before, v, strict=True)]
    v = f(t + h, now)
    return [(a + b + s * c) / 2 for a, b, c in zip(now, before, v, strict=True)]


def _slope(g, t, x, v):
    """Return dg/dt along x' = v, by central differences of g in twice the digits."""
    with mp.workdps(2 * DIGITS):
        e = mp.mpf(10) ** -(DIGITS - 4)
        there = [a + e * b for a, b in zip(x, v, strict=True)]
        back = [a - e * b for a, b in zip(x, v, strict=True)]
        return (g(t + e, there) - g(t - e, back)) / (2 * e)


def filippov(name, field, switch, x0, end, many=41) -> ArcCase:
    """Make the case of a Filippov system.

    Where two surfaces are slid on, the rate of neither depends on the sign of the other.
    """
    case = Case(name, Filippov.signs(field, switch), x0, np.linspace(0.0, end, many))

    def path():
        f = field(Mp)
        c = switch(Mp)
        signs = [1 if v >= 0 else -1 for v in c(mp.mpf(0), [mp.mpf(float(v)) for v in x0])]
        held: list[int] = []

        def rates(t, x, i):
            sides = ([*signs[:i], s, *signs[i + 1 :]] for s in (1, -1))
            return [_slope(lambda t, x: c(t, x)[i], t, x, f(t, x, s)) for s in sides]

        def weights(t, x):
            out = list(signs)
            for i in held:
                up, down = rates(t, x, i)
                out[i] = (up + down) / (down - up)
            return out

        def watched(t, x):
            s = weights(t, x)
            free = [mp.mpf(1) if i in held else s[i] * v for i, v in enumerate(c(t, x))]
            return free + [1 - abs(s[i]) for i in held]

        def ended(t, x, k):
            if k >= len(signs):
                i = held.pop(k - len(signs))
                up, down = rates(t, x, i)
                signs[i] = 1 if abs(up) < abs(down) else -1
                return
            up, down = rates(t, x, k)
            if up < 0 < down:
                held.append(k)
            else:
                signs[k] = -signs[k]

        return Path(lambda t, x: f(t, x, weights(t, x)), watched, ended)

    return ArcCase(case, path)


def contacts(name, drift, A, walls, x0, end, many=41) -> ArcCase:
    """Make the case of a gradient system with 0 <= A x + walls(t); the start touches nothing."""
    A = np.asarray(A, float)
    family = Affine(A, walls)
    case = Case(name, Complementarity(drift, (family,)), x0, np.linspace(0.0, end, many))

    def path():
        f = drift(Mp)
        b = walls(Mp)
        rows = [[mp.mpf(float(v)) for v in row] for row in A]
        held: list[int] = []

        def gap(t, x, i):
            return mp.fdot(rows[i], x) + b(t)[i]

        def solved(t, x, on):
            free = f(t, x)
            if not on:
                return free, []
            G = mp.matrix([[mp.fdot(rows[i], rows[j]) for j in on] for i in on])
            rate = mp.matrix([-_slope(lambda t, x, i=i: gap(t, x, i), t, x, free) for i in on])
            lam = list(mp.lu_solve(G, rate))
            parts = ([m * a for a in rows[i]] for m, i in zip(lam, on, strict=True))
            push = zip(*parts, strict=True)
            return [a + sum(p) for a, p in zip(free, push, strict=True)], lam

        def watched(t, x):
            open_ = [mp.mpf(1) if i in held else gap(t, x, i) for i in range(len(rows))]
            return open_ + solved(t, x, held)[1]

        def ended(t, x, k):
            at = [*held] if k >= len(rows) else [*held, k]
            leaving = held[k - len(rows)] if k >= len(rows) else -1
            for many in range(len(at), -1, -1):
                for on in combinations(at, many):
                    v, lam = solved(t, x, on)
                    rest = [i for i in at if i not in on]
                    away = all(
                        _slope(lambda t, x, i=i: gap(t, x, i), t, x, v) > -JUST_MET for i in rest
                    )
                    if leaving not in on and all(m >= 0 for m in lam) and away:
                        held[:] = on
                        return

        return Path(lambda t, x: solved(t, x, held)[0], watched, ended)

    return ArcCase(case, path)


def diode(name, A, B, C, D, u, q, x0, end, many=41) -> ArcCase:
    """Make the case of a linear complementarity system with one multiplier and D > 0."""
    system = LCS(np.array(A), np.array(B)[:, None], np.array([C]), np.array([[D]]), u, q)
    case = Case(name, system, x0, np.linspace(0.0, end, many))

    def path():
        force = u(Mp) if u else None
        shift = q(Mp) if q else None
        on = [False]

        def blocked(t, x):
            return mp.fdot(C, x) + (shift(t)[0] if shift else 0)

        def rhs(t, x):
            lam = -blocked(t, x) / mp.mpf(D) if on[0] else 0
            v = [mp.fdot(row, x) + b * lam for row, b in zip(A, B, strict=True)]
            return [a + p for a, p in zip(v, force(t), strict=True)] if force else v

        def ended(t, x, k):
            on[0] = not on[0]

        return Path(rhs, lambda t, x: [-blocked(t, x) if on[0] else blocked(t, x)], ended)

    return ArcCase(case, path)
