"""The functions of numpy that a Jet takes: what each does to Taylor coefficients with radii (see nsbench.jets)."""
from __future__ import annotations

import numpy as np

from nsbench.jets import ORDER, Jet, _arranged, _jets, as_jet
from nsbench.kernels import jets as kernel

UNIT = kernel.UNIT


def _pair(a, b):
    """Two Jets with the same shape, flat rows; and that shape."""
    pieces = next(_jets((a, b))).mid.shape[-2]
    a, b = as_jet(a, pieces), as_jet(b, pieces)
    return (*(np.broadcast_arrays(a.mid, b.mid)), *(np.broadcast_arrays(a.rad, b.rad)))


def _flat(*arrays):
    return [np.array(a).reshape(-1, ORDER + 1) for a in arrays]


def _new(shape):
    m, r = np.empty(shape), np.empty(shape)
    return Jet(m, r), m.reshape(-1, ORDER + 1), r.reshape(-1, ORDER + 1)


def _rounded(mid, rad):
    return Jet(mid, rad + UNIT * np.abs(mid))


def _constant(a):
    """(array ready to broadcast) if `a` does not move, else None."""
    if isinstance(a, Jet):
        return None
    a = np.asarray(a)
    if a.dtype.kind not in "fiub":
        return None
    return a[..., None, None].astype(float)


def add(a, b):
    for u, v in ((a, b), (b, a)):
        c = _constant(v)
        if c is not None:
            mid = u.mid + np.zeros_like(c)
            mid[..., 0] += c[..., 0]
            return _rounded(mid, u.rad + np.zeros_like(c))
    am, bm, ar, br = _pair(a, b)
    return _rounded(am + bm, ar + br)


def subtract(a, b):
    return add(a, -b if isinstance(b, Jet) else np.negative(b))


def multiply(a, b):
    for u, v in ((a, b), (b, a)):
        c = _constant(v)
        if c is not None:
            return _rounded(u.mid * c, np.where(c == 0.0, 0.0, u.rad * np.abs(c)))
    if a is b:
        return square(a)
    am, bm, ar, br = _pair(a, b)
    out, m, r = _new(am.shape)
    am, bm, ar, br = _flat(am, bm, ar, br)
    kernel.multiply(am, ar, bm, br, m, r)
    return out


def divide(a, b):
    c = _constant(b)
    if c is not None:
        return multiply(a, 1.0 / c[..., 0, 0])
    am, bm, ar, br = _pair(a, b)
    out, m, r = _new(am.shape)
    am, bm, ar, br = _flat(am, bm, ar, br)
    kernel.divide(am, ar, bm, br, m, r)
    return out


def _head(mid, rad):
    """Rounding of a library function: a few units."""
    return np.ascontiguousarray(mid).ravel(), np.ascontiguousarray(rad + 4 * UNIT * np.abs(mid)).ravel()


def power(a, b):
    if not isinstance(b, Jet) and np.ndim(b) == 0 and float(b) == int(b) and 0 <= b <= 32:
        return _whole(a, int(b))
    if isinstance(b, Jet):
        return exp(multiply(b, log(as_jet(a, b.mid.shape[-2]))))
    if np.ndim(b):
        raise TypeError("no Jet to an array of powers")
    if float(b) < 0 and float(b) == int(b):
        return divide(1.0, power(a, -b))
    return _root(a, float(b))


def _whole(a, k):
    if k == 0:
        return as_jet(np.ones(a.shape), a.mid.shape[-2])
    half = _whole(a, k // 2) if k > 1 else None
    if k == 1:
        return a
    return square(half) if k % 2 == 0 else multiply(square(half), a)


def square(a):
    """a a, knowing that it is not negative."""
    (out, m, r), (lo, hi) = _new(a.mid.shape), a.range
    am, ar = _flat(a.mid, a.rad)
    kernel.multiply(am, ar, am, ar, m, r)
    u, v = np.where((lo < 0.0) & (hi > 0.0), 0.0, np.minimum(lo * lo, hi * hi)), np.maximum(lo * lo, hi * hi)
    out.mid[..., 0], out.rad[..., 0] = 0.5 * (u + v), 0.5 * (v - u) * (1.0 + UNIT) + UNIT * (u + v)
    return out


def _root(a, alpha):
    """a^alpha for a > 0."""
    lo, hi = (np.maximum(v, 0.0) for v in a.range)
    u, v = np.minimum(lo**alpha, hi**alpha), np.maximum(lo**alpha, hi**alpha)
    out, m, r = _new(a.mid.shape)
    kernel.power(*_flat(a.mid, a.rad), *_head(0.5 * (u + v), 0.5 * (v - u)), alpha, m, r)
    return out


def exp(a):
    out, m, d = _new(a.mid.shape)
    kernel.exponential(*_flat(a.mid, a.rad), *_head(*_between(np.exp, *a.range)), m, d)
    return out


def _primitive(slope, a, mid, rad):
    """The Jet with derivative slope * a' and first row mid +- rad."""
    sm, am, sr, ar = _pair(slope, a)
    out, m, r = _new(am.shape)
    kernel.integrate(*_flat(sm, sr, am, ar), *_head(mid, rad), m, r)
    return out


def _between(f, lo, hi):
    """Middle and radius of a growing function's range."""
    u, v = f(lo), f(hi)
    return 0.5 * (u + v), 0.5 * (v - u)


def log(a):
    return _primitive(divide(1.0, a), a, *_between(np.log, *a.range))


def arctan(a):
    return _primitive(divide(1.0, add(multiply(a, a), 1.0)), a, *_between(np.arctan, *a.range))


def _circular(a, sign):
    out_s, sm, sr = _new(a.mid.shape)
    out_c, cm, cr = _new(a.mid.shape)
    m, r = a.mid[..., 0], a.rad[..., 0]
    if sign < 0:
        s, c = np.sin(m), np.cos(m)
        rs, rc = np.minimum(np.abs(c) * r + r * r / 2, 2.0), np.minimum(np.abs(s) * r + r * r / 2, 2.0)
        ease = UNIT * (1.0 + 0.1 * np.abs(m))           # of the reduced argument
        rs, rc = rs + ease, rc + ease
    else:
        s, c = np.sinh(m), np.cosh(m)
        rs = rc = c * np.sinh(r) + np.abs(s) * (np.cosh(r) - 1.0) + np.abs(s) * np.sinh(r)
    for values, radii, vm, vr in ((s, rs, sm, sr), (c, rc, cm, cr)):
        vm[:, 0], vr[:, 0] = _head(values, radii)
    kernel.circular(*_flat(a.mid, a.rad), sm, sr, cm, cr, float(sign))
    return out_s, out_c


def tan(a):
    s, c = _circular(a, -1)
    return divide(s, c)


def tanh(a):
    """1 - 2 / (e^2a + 1), from the side where the exponential stays small."""
    flip = np.where(a.mid[..., 0] > 0.0, -1.0, 1.0)[..., None]
    e = exp(Jet(2.0 * flip * a.mid, 2.0 * a.rad))
    y = divide(subtract(e, 1.0), add(e, 1.0))
    return Jet(flip * y.mid, y.rad)


def _either(a, b, first, second):
    """a where `first` is proven, b where `second` is, else their hull, without derivatives. Masks (*shape, K)."""
    am, bm, ar, br = _pair(a, b)
    first, second = np.broadcast_arrays(first, second)
    m = np.where(first[..., None], am, bm)
    r = np.where(first[..., None], ar, br)
    open_ = np.broadcast_to(~(first | second), m.shape[:-1])
    if open_.any():
        lo = np.minimum(am[..., 0] - ar[..., 0], bm[..., 0] - br[..., 0])
        hi = np.maximum(am[..., 0] + ar[..., 0], bm[..., 0] + br[..., 0])
        m, r = m.copy(), r.copy()
        m[open_], r[open_] = 0.0, np.inf
        m[..., 0] = np.where(open_, 0.5 * (lo + hi), m[..., 0])
        r[..., 0] = np.where(open_, 0.5 * (hi - lo), r[..., 0])
    return Jet(m, r)


class Maybe:
    """The truth of a comparison on every piece: yes, no, or neither is proven. Masks (*shape, K)."""
    __slots__ = ("no", "yes")
    __array_ufunc__ = None

    def __init__(self, yes, no):
        self.yes, self.no = yes, no

    def __and__(self, o):
        o = maybe(o, self)
        return Maybe(self.yes & o.yes, self.no | o.no)

    def __or__(self, o):
        o = maybe(o, self)
        return Maybe(self.yes | o.yes, self.no & o.no)

    __rand__, __ror__ = __and__, __or__

    def __invert__(self):
        return Maybe(self.no, self.yes)

    def __getitem__(self, index):
        index = index if isinstance(index, tuple) else (index,)
        full = (*index, slice(None)) if Ellipsis in index else (*index, Ellipsis)
        return Maybe(self.yes[full], self.no[full])

    def __bool__(self):
        if self.yes.all():
            return True
        if self.no.all():
            return False
        raise TypeError("not proven either way: no branch can be taken")

    def __array_function__(self, func, types, args, kwargs):
        if func is np.where:
            return where(*args)
        raise TypeError(f"no {func.__name__} of a comparison of Jets")


def maybe(c, like) -> Maybe:
    if isinstance(c, Maybe):
        return c
    c = np.asarray(c, bool)[..., None]
    return Maybe(c, ~c)


def _compare(a, b, strict):
    """a < b, or a <= b."""
    lo, hi = subtract(a, b).range
    return Maybe(hi < 0.0, lo >= 0.0) if strict else Maybe(hi <= 0.0, lo > 0.0)


def where(c, a, b):
    if not isinstance(c, Maybe):
        mask = np.asarray(c, bool)[..., None]
        return _either(a, b, mask, ~mask)
    if not any(True for _ in _jets((a, b))):
        a = as_jet(a, c.yes.shape[-1])
    return _either(a, b, c.yes, c.no)


def maximum(a, b):
    lo, hi = subtract(a, b).range
    out = _either(a, b, lo >= 0.0, hi <= 0.0)
    return out


def minimum(a, b):
    lo, hi = subtract(a, b).range
    return _either(a, b, hi <= 0.0, lo >= 0.0)


def sign(a):
    one = np.ones(a.shape)
    lo, hi = a.range
    return _either(as_jet(one, a.mid.shape[-2]), -one, lo > 0.0, hi < 0.0)


def floor(a):
    lo, hi = (np.floor(v) for v in a.range)
    flat = lo == hi
    mid, rad = np.zeros_like(a.mid), np.where(flat[..., None], 0.0, np.inf) + 0.0 * a.mid
    mid[..., 0], rad[..., 0] = 0.5 * (lo + hi), 0.5 * (hi - lo)
    return Jet(mid, rad)


def arctan2(y, x):
    """Off the cut: the derivative is (x y' - y x') / (x^2 + y^2)."""
    ym, xm, yr, xr = _pair(y, x)
    y, x = Jet(ym.copy(), yr.copy()), Jet(xm.copy(), xr.copy())
    over = divide(1.0, add(multiply(x, x), multiply(y, y)))
    m, away = np.arctan2(ym[..., 0], xm[..., 0]), np.hypot(xm[..., 0], ym[..., 0])
    reach = np.hypot(xr[..., 0], yr[..., 0])
    cut = (xm[..., 0] <= reach) & (np.abs(ym[..., 0]) <= yr[..., 0])
    rad = np.where((reach < away) & ~cut, np.arcsin(np.minimum(reach / np.where(away > 0, away, 1.0), 1.0)), np.inf)
    first = _primitive(multiply(over, x), y, m, rad)
    return subtract(first, _primitive(multiply(over, y), x, np.zeros_like(m), np.zeros_like(m)))


def total(a, axis=None, **_):
    if axis is None:
        a, axis = a.reshape(-1), 0
    axes = tuple(np.sort(np.atleast_1d(axis) % a.ndim))
    n = float(np.prod([a.shape[k] for k in axes]))
    return Jet(a.mid.sum(axes), (a.rad + n * UNIT * np.abs(a.mid)).sum(axes))


def matmul(a, b):
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
    raise TypeError("no product of a Jet matrix with a matrix")


def _fold(pick):
    def fold(a, axis=None, **_):
        if axis is None:
            a, axis = a.reshape(-1), 0
        rows = np.moveaxis(a, axis, 0)
        out = rows[0]
        for k in range(1, len(rows)):
            out = pick(out, rows[k])
        return out
    return fold


def norm(a, ord=None, axis=None, **_):
    if ord not in (None, 2):
        raise TypeError("no Jet of this norm")
    return np.sqrt(total(multiply(a, a), axis))


def clip(a, lo=None, hi=None, **_):
    a = a if lo is None else maximum(a, lo)
    return a if hi is None else minimum(a, hi)


def diff(a, n=1, axis=-1, **_):
    if n != 1 or a.ndim != 1:
        raise TypeError("no Jet of this difference")
    return a[1:] - a[:-1]


UFUNCS = {
    np.add: add, np.subtract: subtract, np.multiply: multiply, np.true_divide: divide, np.power: power,
    np.float_power: power, np.matmul: matmul, np.negative: lambda a: -a, np.positive: lambda a: a,
    np.square: square, np.sqrt: lambda a: _root(a, 0.5), np.reciprocal: lambda a: divide(1.0, a),
    np.cbrt: lambda a: _root(a, 1.0 / 3.0), np.exp: exp, np.expm1: lambda a: subtract(exp(a), 1.0), np.log: log,
    np.log1p: lambda a: log(add(a, 1.0)), np.sin: lambda a: _circular(a, -1)[0], np.cos: lambda a: _circular(a, -1)[1],
    np.tan: tan, np.sinh: lambda a: _circular(a, 1)[0], np.cosh: lambda a: _circular(a, 1)[1], np.tanh: tanh,
    np.arctan: arctan, np.arctan2: arctan2, np.abs: lambda a: maximum(a, -a), np.fabs: lambda a: maximum(a, -a),
    np.maximum: maximum, np.minimum: minimum, np.fmax: maximum, np.fmin: minimum, np.sign: sign, np.floor: floor,
    np.mod: lambda a, b: subtract(a, multiply(floor(divide(a, b)), b)), np.hypot: lambda a, b: _root(a * a + b * b, 0.5),
    np.heaviside: lambda a, h: multiply(add(sign(a), 1.0), 0.5),
    np.less: lambda a, b: _compare(a, b, True), np.less_equal: lambda a, b: _compare(a, b, False),
    np.greater: lambda a, b: _compare(b, a, True), np.greater_equal: lambda a, b: _compare(b, a, False),
}
FUNCTIONS = {
    np.where: where, np.sum: total, np.dot: matmul, np.linalg.norm: norm, np.clip: clip, np.diff: diff,
    np.zeros_like: lambda a, **_: as_jet(np.zeros(a.shape), a.mid.shape[-2]),
    np.ones_like: lambda a, **_: as_jet(np.ones(a.shape), a.mid.shape[-2]),
    np.full_like: lambda a, v, **_: multiply(as_jet(np.ones(a.shape), a.mid.shape[-2]), v),
    np.mean: lambda a, axis=None, **_: divide(total(a, axis), float(a.size if axis is None else a.shape[axis])),
    np.max: _fold(maximum), np.min: _fold(minimum), np.prod: _fold(multiply), np.copy: lambda a, **_: a.copy(),
    np.shape: lambda a: a.shape, np.ndim: lambda a: a.ndim, np.size: lambda a: a.size,
    np.outer: lambda a, b: multiply(a[:, None], b[None]),
}
ARRANGE = {np.stack, np.concatenate, np.hstack, np.vstack, np.column_stack, np.append, np.roll, np.flip, np.tile, np.repeat,
           np.expand_dims, np.squeeze, np.broadcast_to, np.transpose, np.moveaxis, np.swapaxes, np.ravel, np.reshape, np.take,
           np.atleast_1d, np.diag, np.fliplr, np.flipud}

__all__ = ["ARRANGE", "FUNCTIONS", "UFUNCS", "Maybe", "_arranged"]
