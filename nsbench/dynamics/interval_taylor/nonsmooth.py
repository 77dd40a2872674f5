"""Enclose abs, sign, minimum, where and the like of Jets: functions with kinks and jumps.

Smooth where one side is proven; elsewhere the hull of both sides, without derivatives.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from nsbench.dynamics.interval_taylor.arithmetic import pair, subtract
from nsbench.dynamics.interval_taylor.jet import Jet, as_jet, jets_among


def _either(a, b, first, second):
    """Return a where `first` is proven, b where `second` is, else their hull without derivatives.

    Masks (*shape, K).
    """
    am, bm, ar, br = pair(a, b)
    first, second = np.broadcast_arrays(first, second)
    m = np.where(first[..., None], am, bm)
    r = np.where(first[..., None], ar, br)
    open_ = np.broadcast_to(~(first | second), m.shape[:-1])
    if open_.any():
        lo = np.minimum(am[..., 0] - ar[..., 0], bm[..., 0] - br[..., 0])
        hi = np.maximum(am[..., 0] + ar[..., 0], bm[..., 0] + br[..., 0])
        m = m.copy()
        r = r.copy()
        m[open_], r[open_] = 0.0, np.inf
        m[..., 0] = np.where(open_, 0.5 * (lo + hi), m[..., 0])
        r[..., 0] = np.where(open_, 0.5 * (hi - lo), r[..., 0])
    return Jet(m, r)


class Maybe:
    """Truth of a comparison on every piece: proven, disproven, or neither.

    yes, no: masks (*shape, K).
    """

    __slots__ = ("no", "yes")
    __array_ufunc__ = None

    def __init__(self, yes: np.ndarray, no: np.ndarray):
        self.yes = yes
        self.no = no

    def __and__(self, o):
        o = maybe(o, self)
        return Maybe(self.yes & o.yes, self.no | o.no)

    def __or__(self, o):
        o = maybe(o, self)
        return Maybe(self.yes | o.yes, self.no & o.no)

    __rand__ = __and__
    __ror__ = __or__

    def __invert__(self):
        return Maybe(self.no, self.yes)

    def __getitem__(self, index):
        index = index if isinstance(index, tuple) else (index,)
        full = (*index, slice(None)) if Ellipsis in index else (*index, Ellipsis)
        return Maybe(self.yes[full], self.no[full])

    def __bool__(self) -> bool:
        """Return a truth that is proven on all pieces; raise TypeError otherwise."""
        if self.yes.all():
            return True
        if self.no.all():
            return False
        raise TypeError("not proven either way: no branch can be taken")

    def __array_function__(self, func, types, args, kwargs):
        if func is np.where:
            return where(*args)
        raise TypeError(f"no {func.__name__} of a comparison of Jets")


def maybe(c: Maybe | np.ndarray, like) -> Maybe:
    """Return a comparison or a plain boolean array as a Maybe."""
    if isinstance(c, Maybe):
        return c
    c = np.asarray(c, bool)[..., None]
    return Maybe(c, ~c)


def compare(a: Jet | np.ndarray | float, b: Jet | np.ndarray | float, strict: bool) -> Maybe:
    """Compare a < b (strict), or a <= b."""
    lo, hi = subtract(a, b).range
    return Maybe(hi < 0.0, lo >= 0.0) if strict else Maybe(hi <= 0.0, lo > 0.0)


def where(c: Maybe | np.ndarray, a: Jet | np.ndarray | float, b: Jet | np.ndarray | float) -> Jet:
    """Enclose a where c holds, b elsewhere, and the hull of both where c is not proven."""
    if not isinstance(c, Maybe):
        mask = np.asarray(c, bool)[..., None]
        return _either(a, b, mask, ~mask)
    if not any(True for _ in jets_among((a, b))):
        a = as_jet(a, c.yes.shape[-1])
    return _either(a, b, c.yes, c.no)


def maximum(a: Jet | np.ndarray | float, b: Jet | np.ndarray | float) -> Jet:
    """Enclose the larger of a and b."""
    lo, hi = subtract(a, b).range
    out = _either(a, b, lo >= 0.0, hi <= 0.0)
    return out


def minimum(a: Jet | np.ndarray | float, b: Jet | np.ndarray | float) -> Jet:
    """Enclose the smaller of a and b."""
    lo, hi = subtract(a, b).range
    return _either(a, b, hi <= 0.0, lo >= 0.0)


def sign(a: Jet) -> Jet:
    """Enclose the sign of a."""
    one = np.ones(a.shape)
    lo, hi = a.range
    return _either(as_jet(one, a.mid.shape[-2]), -one, lo > 0.0, hi < 0.0)


def floor(a: Jet) -> Jet:
    """Enclose the floor of a.

    Derivatives are zero on pieces where it is constant, else unknown.
    """
    lo, hi = (np.floor(v) for v in a.range)
    flat = lo == hi
    mid = np.zeros_like(a.mid)
    rad = np.where(flat[..., None], 0.0, np.inf) + 0.0 * a.mid
    mid[..., 0] = 0.5 * (lo + hi)
    rad[..., 0] = 0.5 * (hi - lo)
    return Jet(mid, rad)


def fold(pick: Callable) -> Callable:
    """Build a reduction along an axis, as np.max is, from a function of two Jets."""

    def fold(a: Jet, axis: int | None = None, **_: object) -> Jet:
        if axis is None:
            a = a.reshape(-1)
            axis = 0
        rows = np.moveaxis(a, axis, 0)
        out = rows[0]
        for k in range(1, len(rows)):
            out = pick(out, rows[k])
        return out

    return fold


def clip(a: Jet | np.ndarray | float, lo=None, hi=None, **_) -> Jet | np.ndarray | float:
    """Enclose a limited to [lo, hi]; None is no limit."""
    a = a if lo is None else maximum(a, lo)
    return a if hi is None else minimum(a, hi)
