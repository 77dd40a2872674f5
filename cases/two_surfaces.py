"""Two surfaces: sliding on the intersection of two planes, x1 = 0 and x2 = 0.

kind="affine":  x1' = p - s1 + k s2,  x2' = q - k s1 - s2,  x3' = 1 + s1 - s2 / 2,  s_i in Sgn(x_i),
                p = 0.3 sin t, q = 0.3 cos t, k = 0.4, from (1, 0.5, 0).
The velocity is affine in the signs, so that all convex combinations that stay on both planes move alike. The point
meets x2 = 0 at T1, slides on it with s2 = q - k, and reaches the intersection at T2; there (s1, s2) solve two
equations, s1 = (p + k q) / (1 + k^2), s2 = (q - k p) / (1 + k^2). Every arc integrates to sines and cosines.

kind="generic": four constant fields, (-1, -1, 1) where x1, x2 > 0, (-1, 2, 0) for x2 < 0 < x1, (2, -1, 0) for
x1 < 0 < x2, (1.5, 1, 5) where both are negative; from (0.5, 0.5, 0). All push to the intersection, which is reached at
t = 1/2. Of the four weights two remain free but one: the velocity along it may be any in [LOW, HIGH], and x3 any curve
with such slopes. The multilinear convention of `Filippov` picks one; a method that chatters picks another. Not unique:
compared are the states with the set of all solutions, and nothing else.
"""
from itertools import combinations

import numpy as np

from nsbench import Case, Filippov

SUITES = {"standard": [{}], "full": [{"kind": "generic"}]}
K, A = 0.4, 0.3                        # coupling and forcing; |s_i| stays below 0.42 on the intersection
START = (1.0, 0.5)
CORNERS = {(1, 1): (-1.0, -1.0, 1.0), (1, -1): (-1.0, 2.0, 0.0), (-1, 1): (2.0, -1.0, 0.0), (-1, -1): (1.5, 1.0, 5.0)}


def planes(xp):
    def c(t, x):
        return x[:2] + 0.0
    return c


def field(xp):
    def f(t, x, s):
        return xp.array([A * xp.sin(t) - s[0] + K * s[1], A * xp.cos(t) - K * s[0] - s[1], 1.0 + s[0] - 0.5 * s[1]])
    return f


def constant(v):
    def make(xp):
        def f(t, x):
            return xp.array([v[0], v[1], v[2]]) + 0.0 * x
        return f
    return make


def root(f, lo, hi):
    """The zero of a decreasing f in [lo, hi], by bisection to the last bit."""
    while hi - lo > 2.0 * np.spacing(hi):
        mid = 0.5 * (lo + hi)
        lo, hi = (mid, hi) if f(mid) > 0.0 else (lo, mid)
    return 0.5 * (lo + hi)


def signs(t, arc):
    """Integrals of (s1, s2) from 0 to t with the formulas of one arc: 0 free, 1 on x2 = 0, 2 on the intersection."""
    P, Q = A * (1.0 - np.cos(t)), A * np.sin(t)
    if arc == 0:
        return np.stack([t, t], 1)
    if arc == 1:
        return np.stack([t, Q - K * t], 1)
    return np.stack([P + K * Q, Q - K * P], 1) / (1.0 + K * K)


def affine() -> dict:
    x1 = lambda s, t: START[0] + A * (1.0 - np.cos(t)) - s[:, 0] + K * s[:, 1]
    x2 = lambda s, t: START[1] + A * np.sin(t) - K * s[:, 0] - s[:, 1]
    at = np.atleast_1d
    T1 = root(lambda t: x2(signs(at(t), 0), t)[0], 0.0, 1.0)
    to = lambda t: signs(at(T1), 0) + signs(at(t), 1) - signs(at(T1), 1)
    T2 = root(lambda t: x1(to(t), t)[0], T1, 4.0)

    def integral(t):
        a, b = np.minimum(t, T1), np.clip(t, T1, T2)
        late = np.maximum(t, T2)
        return (signs(a, 0) + signs(b, 1) - signs(at(T1), 1) + signs(late, 2) - signs(at(T2), 2))

    def exact(t):
        s = integral(t)
        return np.stack([np.where(t < T2, x1(s, t), 0.0), np.where(t < T1, x2(s, t), 0.0),
                         t + s[:, 0] - 0.5 * s[:, 1]], 1)

    def exact_impulse(t):
        return 0.5 * (t[:, None] + integral(t))

    return {"problem": Filippov.signs(field, planes), "x0": np.array([*START, 0.0]), "exact": exact,
            "exact_impulse": exact_impulse, "exact_events": (T1, T2)}


def speeds():
    """Least and largest velocity along the intersection: at the ends of the segment of weights one field has none."""
    out = []
    for chosen in combinations(CORNERS.values(), 3):
        M = np.array(chosen).T
        w = np.linalg.solve(np.vstack([M[:2], np.ones(3)]), [0.0, 0.0, 1.0])
        if w.min() >= 0.0:
            out.append(float(M[2] @ w))
    return min(out), max(out)


LOW, HIGH = speeds()


def distance(t, x):
    """Largest miss of x1 and x2, and the least r for which a curve with slopes in [LOW, HIGH] passes within r of every
    x3: what two samples ask too much of a slope is shared by both, and the start is known."""
    late = np.maximum(t - 0.5, 0.0)
    off = np.abs(x[:, :2] - np.maximum(0.5 - t, 0.0)[:, None]).max()
    z = x[:, 2] - np.minimum(t, 0.5)
    rise, span = z[:, None] - z[None, :], late[:, None] - late[None, :]
    excess = np.tril(np.maximum(rise - HIGH * span, LOW * span - rise))       # from an earlier sample to a later one
    fixed = np.maximum(z - HIGH * late, LOW * late - z)
    return float(max(off, 0.5 * excess.max(), fixed.max()))


def make(kind: str = "affine") -> Case:
    """kind: "affine" (unique velocity and weights) or "generic" (neither)."""
    if kind not in ("affine", "generic"):
        raise ValueError(f'kind is {kind!r}; "affine" or "generic"')
    data = affine() if kind == "affine" else {
        "problem": Filippov({k: constant(v) for k, v in CORNERS.items()}, planes), "x0": np.array([0.5, 0.5, 0.0]),
        "unique": False, "distance": distance, "tags": ("corner",)}
    return Case(name="two_surfaces", t=np.linspace(0.0, 3.0, 31), **data)
