"""Interval Taylor arithmetic: truncated Taylor series with error radii, as a numpy array type.

A `Jet` stands for K functions at once (the pieces), for each the coefficients  q^(j)(s) r^j / j!,
j = 0 .. ORDER, enclosed for every s of its piece (radius r). A factory written over an array
namespace takes Jets as it takes arrays:
`drift(SPACE)(t, x)` encloses f(t, x(t)) and its derivatives along a polynomial x(t), because numpy
hands its functions to the class. What a kink or a jump leaves undefined is an infinite radius. What
a Jet cannot do (branch on a value, turn into a float) is a TypeError: then nothing is proven.
Source: Moore, Interval Analysis, 1966, chapter 11 (interval Taylor series); rounding is enclosed by
UNIT of kernels.coefficient_recurrences. The functions of numpy that a Jet takes are registered
from below, by interval_taylor.numpy_functions, as they are written in terms of Jets.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

import numpy as np

from nsbench.compilation.user_forms.draft_array import Draft, DraftNamespace, holds_drafts, settled
from nsbench.dynamics.array_operator_mixin import ArrayOperators

ORDER = 9  # one more than the degree of the interpolants that the last coefficient bounds
# numbers below it among those of entries are values of the caller's that came in with them
FOREIGN = 2**40
MOST_ENTRIES = 50_000  # of one Jet: beyond, a proof costs more than the step it is for

# numpy function -> implementation; of the last only the entries move
_ufuncs: dict[Callable, Callable] = {}
_functions: dict[Callable, Callable] = {}
_rearrangements: set[Callable] = set()


def register_numpy_functions(
    ufuncs: dict[Callable, Callable],
    functions: dict[Callable, Callable],
    rearrangements: set[Callable],
) -> None:
    """Register the functions of numpy that a Jet takes.

    ufuncs, functions: with what implements them; rearrangements: those that only move entries.
    """
    _ufuncs.update(ufuncs)
    _functions.update(functions)
    _rearrangements.update(rearrangements)


class Jet(ArrayOperators):
    """Enclosed Taylor coefficients mid +- rad (*shape, K, ORDER + 1).

    A Jet looks like a float64 array of `shape`.
    """

    __slots__ = ("mid", "rad")

    def __init__(self, mid, rad):
        if mid.size > MOST_ENTRIES * (ORDER + 1):
            raise TypeError("a Jet this large is not worth its time")
        self.mid = mid
        self.rad = rad

    shape = property(lambda self: self.mid.shape[:-2])
    ndim = property(lambda self: self.mid.ndim - 2)
    size = property(lambda self: int(np.prod(self.shape)))
    T = property(lambda self: self.transpose())
    range = property(
        lambda self: (self.mid[..., 0] - self.rad[..., 0], self.mid[..., 0] + self.rad[..., 0])
    )

    def __array_ufunc__(self, ufunc, method, *inputs, **kwargs):
        if holds_drafts(inputs, kwargs):
            return NotImplemented
        if (
            method == "__call__"
            and ufunc in _ufuncs
            and not any(v is not None for v in kwargs.values())
        ):
            with np.errstate(all="ignore"):  # what overflows is an infinite radius
                return _ufuncs[ufunc](*inputs)
        raise TypeError(f"no Jet of {ufunc.__name__}")

    def __array_function__(self, func, types, args, kwargs):
        if Draft in types:
            return NotImplemented
        if func in _functions:
            return _functions[func](*args, **kwargs)
        if func in _rearrangements:
            return _arranged(func, *args, **kwargs)
        raise TypeError(f"no Jet of {func.__name__}")

    def __bool__(self):
        raise TypeError("a Jet has no truth value")

    def __float__(self):
        raise TypeError("a Jet is no float")

    def __len__(self):
        if not self.shape:
            raise TypeError("a Jet of no dimension has no length")
        return self.shape[0]

    def __getitem__(self, index):
        return self._each(np.ndarray.__getitem__, self._with_coefficients(index))

    def __setitem__(self, index, value):
        value = as_jet(value, self.mid.shape[-2])
        full = self._with_coefficients(index)
        self.mid[full] = value.mid
        self.rad[full] = value.rad

    def _with_coefficients(self, index):
        """Return the index of all coefficients of the entries; IndexError if there are none."""
        np.broadcast_to(0.0, self.shape)[index]
        index = index if isinstance(index, tuple) else (index,)
        open_ = any(i is Ellipsis for i in index)
        return (*index, slice(None), slice(None)) if open_ else (*index, Ellipsis)

    def _each(self, func, *args):
        """Return the Jet of func(middles) and func(radii), which share entries as arrays do."""
        return Jet(func(self.mid, *args), func(self.rad, *args))

    def reshape(self, *shape) -> Jet:
        """Return the Jet with another shape, given as a tuple or as arguments."""
        shape = np.atleast_1d(np.array(shape[0] if len(shape) == 1 else shape, int))
        return self._each(np.reshape, (*shape, *self.mid.shape[-2:]))

    def transpose(self, axes: tuple | None = None) -> Jet:
        """Return the Jet with its dimensions in another order, or in the opposite one."""
        order = range(self.ndim)[::-1] if axes is None else [k % self.ndim for k in axes]
        return self._each(np.transpose, (*order, -2, -1))

    def copy(self) -> Jet:
        """Return a copy that shares no array."""
        return Jet(self.mid.copy(), self.rad.copy())

    def astype(self, dtype) -> Jet:
        """Return a copy; raise TypeError for a type other than float64."""
        if np.dtype(dtype) != np.float64:
            raise TypeError(f"no Jet of {dtype}")
        return self.copy()

    def __neg__(self):
        return Jet(-self.mid, self.rad.copy())

    def __abs__(self):
        return np.abs(self)

    def __lt__(self, o):
        return np.less(self, o)

    def __le__(self, o):
        return np.less_equal(self, o)

    def __gt__(self, o):
        return np.greater(self, o)

    def __ge__(self, o):
        return np.greater_equal(self, o)

    def sum(self, axis: int | tuple | None = None) -> Jet:
        """Enclose the sum of the entries, as numpy.sum."""
        return np.sum(self, axis=axis)

    def dot(self, o) -> Jet:
        """Enclose the product with `o`, as numpy.matmul."""
        return np.matmul(self, o)

    def min(self, axis: int | None = None) -> Jet:
        """Enclose the smallest entry, as numpy.min."""
        return np.min(self, axis=axis)

    def max(self, axis: int | None = None) -> Jet:
        """Enclose the largest entry, as numpy.max."""
        return np.max(self, axis=axis)


def as_jet(value, pieces: int) -> Jet:
    """Return a Jet that is constant in time on so many pieces, or `value` if it is a Jet.

    Arrays and lists of Jets become one Jet. Raises TypeError for types that are no numbers.
    """
    value = settled(value)
    if isinstance(value, Jet):
        return value
    if isinstance(value, (list, tuple)) and any(isinstance(v, (Jet, list, tuple)) for v in value):
        return np.stack([as_jet(v, pieces) for v in value])
    a = np.asarray(value)
    if a.dtype == object:
        return np.stack([as_jet(v, pieces) for v in a]) if a.ndim else as_jet(a.item(), pieces)
    if a.dtype.kind not in "fiub":
        raise TypeError(f"no Jet of {a.dtype}")
    mid = np.zeros((*a.shape, pieces, ORDER + 1))
    mid[..., 0] = a[..., None]
    return Jet(mid, np.zeros_like(mid))


def enclosing(mid: np.ndarray, rad: np.ndarray) -> Jet:
    """Return every constant within mid +- rad, each (*shape, K), on K pieces as a Jet."""
    coefficients = np.zeros((2, *np.shape(mid), ORDER + 1))
    coefficients[0, ..., 0] = mid
    coefficients[1, ..., 0] = rad + 1e-15 * (np.abs(mid) + rad)
    return Jet(*coefficients)


def _arranged(func, *args, **kwargs):
    """Apply func, which only moves entries, to Jets.

    It is applied to the indices of their entries. Raises TypeError if the result is no arrangement
    of them.
    """
    pool = []
    first = [FOREIGN]
    pieces = next(j.mid.shape[-2] for j in jets_among(args))

    def number(a: object) -> object:
        if isinstance(a, (list, tuple)) and any(True for _ in jets_among(a)):
            return type(a)(number(as_jet(v, pieces)) for v in a)
        if not isinstance(a, Jet):
            return a
        index = np.arange(first[0], first[0] + a.size).reshape(a.shape)
        pool.append(a)
        first[0] += a.size
        return index

    index = func(*[number(a) for a in args], **kwargs)
    if isinstance(index, (list, tuple)) or np.any(np.asarray(index) < FOREIGN):
        raise TypeError(f"no Jet of {func.__name__}")
    index = np.asarray(index) - FOREIGN
    mid = np.concatenate([j.mid.reshape(-1, pieces, ORDER + 1) for j in pool])
    rad = np.concatenate([j.rad.reshape(-1, pieces, ORDER + 1) for j in pool])
    return Jet(mid[index], rad[index])


def jets_among(args: Iterable) -> Iterator[Jet]:
    """Yield the Jets among args and within its lists and tuples."""
    for a in args:
        if isinstance(a, Jet):
            yield a
        elif isinstance(a, (list, tuple)):
            yield from jets_among(a)


class _Space(DraftNamespace):
    """The namespace to hand to a factory: numpy, with constructors that take Jets."""

    def convert(self, name, value, dtype) -> np.ndarray | Jet:
        """Build an array, or a Jet if the value contains one."""
        found = next(jets_among([value]), None)
        if found is None:
            return super().convert(name, value, dtype)
        made = as_jet(value, found.mid.shape[-2])
        return made.copy() if name == "array" else made


SPACE = _Space()


def clock(centre: np.ndarray, radius: np.ndarray) -> Jet:
    """Return the time as a Jet on K pieces with these centres and radii (K,)."""
    mid = np.zeros((len(centre), ORDER + 1))
    mid[:, 0] = centre
    mid[:, 1] = radius
    rad = np.zeros_like(mid)
    rad[:, 0] = radius + 1e-15 * (np.abs(centre) + radius)
    rad[:, 1] = 1e-15 * radius
    return Jet(mid, rad)


def path(c: np.ndarray) -> Jet:
    """Return polynomials over pieces as a Jet of shape (n,).

    c (n, K, ORDER): the coefficients in s, |s| <= 1, on each piece. The Taylor coefficient j at s
    is  sum_k binomial(k, j) c_k s^(k-j).
    """
    mid = np.zeros((*c.shape[:2], ORDER + 1))
    rad = np.zeros((*c.shape[:2], ORDER + 1))
    mid[..., :ORDER] = c
    rad[..., :ORDER] = np.abs(c) @ _BINOMIAL + 4e-15 * np.abs(c)
    return Jet(mid, rad)


def _binomials():
    """Return (ORDER, ORDER) the binomial coefficients of k over j for j < k, else 0."""
    from math import comb

    return np.array(
        [[comb(k, j) if j < k else 0 for j in range(ORDER)] for k in range(ORDER)], float
    )


_BINOMIAL = _binomials()
