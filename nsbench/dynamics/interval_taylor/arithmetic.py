"""Arithmetic, elementary functions and sums of Jets: Taylor coefficients with error radii."""

from __future__ import annotations

import numpy as np

from nsbench.dynamics.interval_taylor.jet import ORDER, Jet, as_jet, jets_among
from nsbench.dynamics.interval_taylor.kernels import coefficient_recurrences

UNIT = coefficient_recurrences.UNIT


def pair(a: Jet | np.ndarray | float, b: Jet | np.ndarray | float) -> tuple[np.ndarray, ...]:
    """Broadcast two Jets, or a Jet and an array; return both middles, then both radii."""
    pieces = next(jets_among((a, b))).mid.shape[-2]
    a = as_jet(a, pieces)
    b = as_jet(b, pieces)
    return (*(np.broadcast_arrays(a.mid, b.mid)), *(np.broadcast_arrays(a.rad, b.rad)))


def _flat(*arrays):
    """Copy arrays to rows of ORDER + 1 coefficients."""
    return [np.array(a).reshape(-1, ORDER + 1) for a in arrays]


def _new(shape):
    """Return an empty Jet, and its middles and radii as rows of coefficients."""
    m = np.empty(shape)
    r = np.empty(shape)
    return Jet(m, r), m.reshape(-1, ORDER + 1), r.reshape(-1, ORDER + 1)


def _rounded(mid, rad):
    """Return the Jet with its radii enlarged by the rounding of its middles."""
    return Jet(mid, rad + UNIT * np.abs(mid))


def _constant(a):
    """Return a numeric array ready to broadcast, or None if `a` depends on time."""
    if isinstance(a, Jet):
        return None
    a = np.asarray(a)
    if a.dtype.kind not in "fiub":
        return None
    return a[..., None, None].astype(float)


def add(a: Jet | np.ndarray | float, b: Jet | np.ndarray | float) -> Jet:
    """Enclose a + b."""
    for u, v in ((a, b), (b, a)):
        c = _constant(v)
        if c is not None:
            mid = u.mid + np.zeros_like(c)
            mid[..., 0] += c[..., 0]
            return _rounded(mid, u.rad + np.zeros_like(c))
    am, bm, ar, br = pair(a, b)
    return _rounded(am + bm, ar + br)


def subtract(a: Jet | np.ndarray | float, b: Jet | np.ndarray | float) -> Jet:
    """Enclose a - b."""
    return add(a, -b if isinstance(b, Jet) else np.negative(b))


def multiply(a: Jet | np.ndarray | float, b: Jet | np.ndarray | float) -> Jet:
    """Enclose a b; a square if both are the same object."""
    for u, v in ((a, b), (b, a)):
        c = _constant(v)
        if c is not None:
            return _rounded(u.mid * c, np.where(c == 0.0, 0.0, u.rad * np.abs(c)))
    if a is b:
        return square(a)
    am, bm, ar, br = pair(a, b)
    out, m, r = _new(am.shape)
    am, bm, ar, br = _flat(am, bm, ar, br)
    coefficient_recurrences.multiply(am, ar, bm, br, m, r)
    return out


def divide(a: Jet | np.ndarray | float, b: Jet | np.ndarray | float) -> Jet:
    """Enclose a / b."""
    c = _constant(b)
    if c is not None:
        return multiply(a, 1.0 / c[..., 0, 0])
    am, bm, ar, br = pair(a, b)
    out, m, r = _new(am.shape)
    am, bm, ar, br = _flat(am, bm, ar, br)
    coefficient_recurrences.divide(am, ar, bm, br, m, r)
    return out


def _head(mid, rad):
    """Flatten middles and radii, with the rounding of a library function added: a few units."""
    return np.ascontiguousarray(mid).ravel(), np.ascontiguousarray(
        rad + 4 * UNIT * np.abs(mid)
    ).ravel()


def power(a: Jet | np.ndarray | float, b: Jet | float) -> Jet:
    """Enclose a^b; raises TypeError if b is an array of exponents.

    Whole exponents up to 32 by products, a Jet in the exponent by exp(b log a), else a root of a >
    0.
    """
    if not isinstance(b, Jet) and np.ndim(b) == 0 and float(b) == int(b) and 0 <= b <= 32:
        return _whole(a, int(b))
    if isinstance(b, Jet):
        return exp(multiply(b, log(as_jet(a, b.mid.shape[-2]))))
    if np.ndim(b):
        raise TypeError("no Jet to an array of powers")
    if float(b) < 0 and float(b) == int(b):
        return divide(1.0, power(a, -b))
    return root(a, float(b))


def _whole(a, k):
    """Enclose a^k for a whole number k >= 0 by repeated squaring."""
    if k == 0:
        return as_jet(np.ones(a.shape), a.mid.shape[-2])
    half = _whole(a, k // 2) if k > 1 else None
    if k == 1:
        return a
    return square(half) if k % 2 == 0 else multiply(square(half), a)


def square(a: Jet) -> Jet:
    """Enclose a^2, with values that are not negative."""
    (out, m, r), (lo, hi) = _new(a.mid.shape), a.range
    am, ar = _flat(a.mid, a.rad)
    coefficient_recurrences.multiply(am, ar, am, ar, m, r)
    u = np.where((lo < 0.0) & (hi > 0.0), 0.0, np.minimum(lo * lo, hi * hi))
    v = np.maximum(lo * lo, hi * hi)
    out.mid[..., 0] = 0.5 * (u + v)
    out.rad[..., 0] = 0.5 * (v - u) * (1.0 + UNIT) + UNIT * (u + v)
    return out


def root(a: Jet, alpha: float) -> Jet:
    """Enclose a^alpha for a > 0."""
    lo, hi = (np.maximum(v, 0.0) for v in a.range)
    u = np.minimum(lo**alpha, hi**alpha)
    v = np.maximum(lo**alpha, hi**alpha)
    out, m, r = _new(a.mid.shape)
    coefficient_recurrences.power(
        *_flat(a.mid, a.rad), *_head(0.5 * (u + v), 0.5 * (v - u)), alpha, m, r
    )
    return out


def exp(a: Jet) -> Jet:
    """Enclose exp(a)."""
    out, m, d = _new(a.mid.shape)
    coefficient_recurrences.exponential(
        *_flat(a.mid, a.rad), *_head(*_between(np.exp, *a.range)), m, d
    )
    return out


def _primitive(slope, a, mid, rad):
    """Return the Jet with the derivative slope a' and the first coefficient mid +- rad."""
    sm, am, sr, ar = pair(slope, a)
    out, m, r = _new(am.shape)
    coefficient_recurrences.integrate(*_flat(sm, sr, am, ar), *_head(mid, rad), m, r)
    return out


def _between(f, lo, hi):
    """Return middle and radius of the range of a growing function on [lo, hi]."""
    u = f(lo)
    v = f(hi)
    return 0.5 * (u + v), 0.5 * (v - u)


def log(a: Jet) -> Jet:
    """Enclose log(a)."""
    return _primitive(divide(1.0, a), a, *_between(np.log, *a.range))


def arctan(a: Jet) -> Jet:
    """Enclose arctan(a)."""
    return _primitive(divide(1.0, add(multiply(a, a), 1.0)), a, *_between(np.arctan, *a.range))


def sine_and_cosine(a: Jet, sign: int) -> tuple[Jet, Jet]:
    """Enclose sine and cosine (sign = -1) or sinh and cosh (sign = +1) of a."""
    out_s, sm, sr = _new(a.mid.shape)
    out_c, cm, cr = _new(a.mid.shape)
    m = a.mid[..., 0]
    r = a.rad[..., 0]
    if sign < 0:
        s = np.sin(m)
        c = np.cos(m)
        rs = np.minimum(np.abs(c) * r + r * r / 2, 2.0)
        rc = np.minimum(np.abs(s) * r + r * r / 2, 2.0)
        ease = UNIT * (1.0 + 0.1 * np.abs(m))  # of the reduced argument
        rs = rs + ease
        rc = rc + ease
    else:
        s = np.sinh(m)
        c = np.cosh(m)
        rs = rc = c * np.sinh(r) + np.abs(s) * (np.cosh(r) - 1.0) + np.abs(s) * np.sinh(r)
    for values, radii, vm, vr in ((s, rs, sm, sr), (c, rc, cm, cr)):
        vm[:, 0], vr[:, 0] = _head(values, radii)
    coefficient_recurrences.circular(*_flat(a.mid, a.rad), sm, sr, cm, cr, float(sign))
    return out_s, out_c


def tan(a: Jet) -> Jet:
    """Enclose tan(a) as sine over cosine."""
    s, c = sine_and_cosine(a, -1)
    return divide(s, c)


def tanh(a: Jet) -> Jet:
    """Enclose tanh(a) = 1 - 2 / (e^2a + 1), from the side where the exponential stays small."""
    flip = np.where(a.mid[..., 0] > 0.0, -1.0, 1.0)[..., None]
    e = exp(Jet(2.0 * flip * a.mid, 2.0 * a.rad))
    y = divide(subtract(e, 1.0), add(e, 1.0))
    return Jet(flip * y.mid, y.rad)


def arctan2(y: Jet | np.ndarray | float, x: Jet | np.ndarray | float) -> Jet:
    """Enclose arctan2(y, x) off the cut.

    The derivative is (x y' - y x') / (x^2 + y^2). Infinite radii where the cut or the origin may be
    reached.
    """
    ym, xm, yr, xr = pair(y, x)
    y = Jet(ym.copy(), yr.copy())
    x = Jet(xm.copy(), xr.copy())
    over = divide(1.0, add(multiply(x, x), multiply(y, y)))
    m = np.arctan2(ym[..., 0], xm[..., 0])
    away = np.hypot(xm[..., 0], ym[..., 0])
    reach = np.hypot(xr[..., 0], yr[..., 0])
    cut = (xm[..., 0] <= reach) & (np.abs(ym[..., 0]) <= yr[..., 0])
    rad = np.where(
        (reach < away) & ~cut,
        np.arcsin(np.minimum(reach / np.where(away > 0, away, 1.0), 1.0)),
        np.inf,
    )
    first = _primitive(multiply(over, x), y, m, rad)
    return subtract(first, _primitive(multiply(over, y), x, np.zeros_like(m), np.zeros_like(m)))


def total(a: Jet, axis: int | tuple | None = None, **_) -> Jet:
    """Enclose the sum over an axis, over several, or over all (None)."""
    if axis is None:
        a = a.reshape(-1)
        axis = 0
    axes = tuple(np.sort(np.atleast_1d(axis) % a.ndim))
    n = float(np.prod([a.shape[k] for k in axes]))
    return Jet(a.mid.sum(axes), (a.rad + n * UNIT * np.abs(a.mid)).sum(axes))


def matmul(a: Jet | np.ndarray | float, b: Jet | np.ndarray | float) -> Jet:
    """Enclose a matrix product with a vector, or of a plain matrix with a Jet.

    Raises TypeError for other products.
    """
    if isinstance(a, Jet) and a.ndim == 2:
        return total(multiply(a, b[None] if np.ndim(b) == 1 else _lift(b)), axis=1)
    if not isinstance(a, Jet) and np.ndim(a) == 2:
        if b.ndim == 1:
            return total(multiply(np.asarray(a), b[None]), axis=1)
        return total(multiply(np.asarray(a)[:, :, None], b[None]), axis=1)
    if np.ndim(a) == 1:
        return total(multiply(a, b) if np.ndim(b) == 1 else multiply(a[:, None], b), axis=0)
    raise TypeError("no Jet of this product")


def _lift(b):
    """Raise TypeError: the product of a Jet matrix with a matrix is not supported."""
    raise TypeError("no product of a Jet matrix with a matrix")


def norm(a: Jet, ord=None, axis: int | tuple | None = None, **_) -> Jet:
    """Enclose the Euclidean norm; raises TypeError for other norms."""
    if ord not in (None, 2):
        raise TypeError("no Jet of this norm")
    return np.sqrt(total(multiply(a, a), axis))


def diff(a: Jet, n: int = 1, axis: int = -1, **_) -> Jet:
    """Enclose the first differences of a vector; raises TypeError for others."""
    if n != 1 or a.ndim != 1:
        raise TypeError("no Jet of this difference")
    return a[1:] - a[:-1]
