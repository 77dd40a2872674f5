"""Arrays that a traced function fills entry by entry, as numpy's are filled.

An array namespace that traces has no assignment into arrays of numbers: they know no traced entry.
A DraftNamespace hands out Drafts instead (zeros, ones, full, empty, those like another array, array
and copy). A Draft is a numpy array of positions in a list of values, to which each assignment
appends: numpy itself does the indexing, and parts of a Draft share its entries exactly where those
of an array would. In an operation, a function or a result a Draft is the array of the namespace
that its entries make at that moment.
"""

from __future__ import annotations

import types
from collections.abc import Callable

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin

UNWRITTEN = -1  # position of an entry of xp.empty
MOST_WRITES = 20_000  # their values are kept as long as the array
# functions and methods whose result shares the entries of an array, or only moves them
ARRANGE = {
    name: getattr(np, name)
    for name in "ravel reshape transpose squeeze expand_dims swapaxes moveaxis flip fliplr flipud "
    "rot90 atleast_1d atleast_2d diagonal broadcast_to roll tile repeat take".split()
}
METHODS = frozenset(("reshape", "ravel", "transpose", "squeeze", "swapaxes", "diagonal", "take"))
# functions and methods that write into an array or share its memory: written as assignments
WRITERS = frozenset(
    (np.copyto, np.put, np.place, np.putmask, np.put_along_axis, np.fill_diagonal)
)
NO_METHODS = frozenset(
    "sort partition put itemset resize setfield setflags byteswap flat view real imag getfield "
    "base data ctypes strides".split()
)


def settled(value: object, done: dict | None = None) -> object:
    """Return a value with the Drafts in it, and in its lists and tuples, as arrays."""
    done = {} if done is None else done
    if isinstance(value, Draft):
        if id(value) not in done:  # one array for one Draft: a product with itself is a square
            done[id(value)] = value.settled()
        return done[id(value)]
    if isinstance(value, (list, tuple)):
        parts = [settled(v, done) for v in value]
        same = all(a is b for a, b in zip(parts, value, strict=True))
        return value if same else tuple(parts) if isinstance(value, tuple) else parts
    return value


def holds_drafts(args: tuple, options: dict) -> bool:
    """Is one of the arguments of a function of numpy, or its `out`, a Draft?"""
    return any(isinstance(v, Draft) for v in (*args, *(options.get("out") or ())))


class _Values:
    """The flat arrays that were written into a Draft; the k-th begins at position starts[k]."""

    def __init__(self, first):
        self.arrays = [first]
        self.starts = [0]
        self.size = first.size

    def append(self, flat) -> int:
        """Add an array; return its first position."""
        if len(self.arrays) >= MOST_WRITES:
            raise TypeError(
                f"an array is written into more than {MOST_WRITES} times; "
                "make it within the function, and write slices"
            )
        start = self.size
        self.arrays.append(flat)
        self.starts.append(start)
        self.size += flat.size
        return start

    def owners(self, positions):
        """Return which array holds each position; TypeError if nothing is written there."""
        if np.any(positions < 0):
            raise TypeError("an entry of xp.empty is used before it is written")
        return np.searchsorted(self.starts, positions, "right") - 1


class Draft(NDArrayOperatorsMixin):
    """A float64 array to fill: positions `where` in the list of its values."""

    __slots__ = ("space", "values", "where")
    dtype = np.dtype(np.float64)
    shape = property(lambda self: self.where.shape)
    ndim = property(lambda self: self.where.ndim)
    size = property(lambda self: self.where.size)
    T = property(lambda self: self._part(self.where.T))

    def __init__(self, space: DraftNamespace, numbers: np.ndarray):
        self.space = space
        self.values = _Values(numbers.ravel())
        self.where = np.arange(numbers.size).reshape(numbers.shape)

    def _part(self, where):
        """Return the Draft of some of the entries."""
        out = object.__new__(Draft)
        out.space = self.space
        out.values = self.values
        out.where = where
        return out

    def settled(self) -> object:
        """Return the array of the namespace that the entries make now."""
        values = self.values
        owners = values.owners(self.where.ravel())
        used = list(dict.fromkeys(owners.tolist())) or [0]  # in the order of the entries
        move = np.zeros(len(values.arrays), np.int64)
        size = 0
        for k in used:
            move[k] = size - values.starts[k]
            size += values.arrays[k].size
        positions = self.where.ravel() + move[owners]
        joined = self.space.join([values.arrays[k] for k in used])
        if not np.array_equal(positions, np.arange(size)):
            joined = joined[positions]
        return joined.reshape(self.shape)

    def __getitem__(self, index):
        if _computed(index):
            return self.settled()[index]
        where = self.where[index]
        if isinstance(where, np.ndarray):
            return self._part(where)
        k = int(self.values.owners(where))
        return self.values.arrays[k][int(where) - self.values.starts[k]]

    def __setitem__(self, index, value):
        if _computed(index):
            now = self.settled()
            if not hasattr(now, "at"):  # as arrays of JAX have
                raise TypeError("an index of `out[i] = v` cannot be traced; write xp.where")
            value = now.at[index].set(settled(value))
            index = ...
        value = self.space.numbers(value)
        start = self.values.append(value.reshape(-1))
        self.where[index] = start + np.arange(value.size).reshape(value.shape)

    def __array_ufunc__(self, ufunc, method, *inputs, out=None, **options):
        if method == "at":
            raise TypeError(f"{ufunc.__name__}.at cannot be traced; write out[i] += v")
        f = getattr(self.space.plain, ufunc.__name__, ufunc)
        f = f if method == "__call__" else getattr(f, method)
        value = f(*settled(inputs), **options)
        if out is None:
            return value
        out[0][...] = value
        return out[0]

    def __array_function__(self, func, classes, args, options):
        if func in ARRANGE.values() and args and isinstance(args[0], Draft):
            return args[0].arranged(func, args[1:], options)
        if func in WRITERS or options.get("out") is not None:
            raise TypeError(f"{func.__name__} into an array cannot be traced; write out[i] = v")
        return _call_settled(func, args, options)

    def arranged(self, func: Callable, args: tuple, options: dict) -> Draft:
        """Return the entries in the order that a function of numpy gives them."""
        return self._part(func(self.where, *args, **options))

    def __array__(self, dtype=None, copy=None):
        value = self.settled()
        if not hasattr(value, "__array__"):
            raise TypeError("an array with traced entries is no array of numbers")
        return np.asarray(value, dtype)

    def __getattr__(self, name):
        if name.startswith("__") or name in NO_METHODS:
            raise AttributeError(
                f"{name} of an array that is filled cannot be traced; write out[i] = v"
            )
        if name in METHODS:
            f = getattr(self.where, name)
            return lambda *args, **options: self._part(f(*args, **options))
        return getattr(self.settled(), name)

    def __len__(self):
        return len(self.where)

    def __iter__(self):
        return (self[k] for k in range(len(self)))

    def __bool__(self):
        return bool(self.settled())

    def __float__(self):
        return float(self.settled())

    def copy(self) -> Draft:
        """Return a Draft of the same entries that shares none."""
        return self._part(self.where.copy())

    def flatten(self) -> Draft:
        """Return a copy in one dimension."""
        return self._part(self.where.flatten())

    def fill(self, value) -> None:
        """Write a number into every entry."""
        self[...] = value


class DraftNamespace:
    """Array namespace `plain` (numpy, or jax.numpy) whose new arrays of float64 are Drafts."""

    def __init__(self, plain: types.ModuleType = np):
        self.plain = plain
        self.__name__ = plain.__name__

    def __getattr__(self, name):
        found = getattr(self.plain, name)
        if self.plain is np:  # numpy hands its functions to the class of the arguments
            return found
        if isinstance(found, types.ModuleType):
            return DraftNamespace(found)
        if isinstance(found, type) or not callable(found):
            return found
        return _Function(found, ARRANGE.get(name) if hasattr(self.plain, "zeros") else None)

    def join(self, parts: list) -> object:
        """Return several flat arrays as a new one."""
        if all(isinstance(p, np.ndarray) for p in parts):
            return self.plain.asarray(np.concatenate(parts))
        return self.plain.concatenate(parts)

    def numbers(self, value: object) -> object:
        """Return what is written into a Draft as an array; TypeError if it is none of floats."""
        value = settled(self.array(value) if isinstance(value, (list, tuple)) else value)
        if not hasattr(value, "dtype"):
            value = np.asarray(value)
        if value.dtype.kind not in "fiub":
            raise TypeError(f"{value.dtype} cannot be written into an array of floats")
        return value.astype(np.float64)

    def convert(self, name: str, value: object, dtype) -> object:
        """Call `array` or `asarray` (name) on what is no list of constants."""
        return getattr(self.plain, name)(value, dtype)

    def array(self, value, dtype=None, **_):
        """Build an array; of lists of constants, or of a Draft, a Draft."""
        if isinstance(value, Draft):
            return value.copy()
        value = settled(value)
        if isinstance(value, (list, tuple)) and _constant(value):
            made = np.array(value, dtype)
            if made.dtype == np.float64:
                return Draft(self, made)
        return self.convert("array", value, dtype)

    def asarray(self, value, dtype=None, **options):
        """Return an array itself; build one as `array` from lists."""
        if isinstance(value, Draft):
            return value
        if isinstance(value, (list, tuple)):
            return self.array(value, dtype, **options)
        return self.convert("asarray", value, dtype)

    def copy(self, a, **_):
        """Return a copy of an array; a Draft of one of floats."""
        out = self.zeros_like(a)
        if not isinstance(out, Draft):
            return self.plain.copy(a)
        out[...] = a
        return out

    def zeros(self, shape, dtype=None, **_):
        """Build an array of zeros, or of another type than float64 one of the namespace."""
        return self.full(shape, 0.0, dtype)

    def ones(self, shape, dtype=None, **_):
        """Build an array of ones."""
        return self.full(shape, 1.0, dtype)

    def empty(self, shape, dtype=None, **_):
        """Build an array whose entries are refused until they are written."""
        out = self.zeros(shape, dtype)
        if isinstance(out, Draft):
            out.where[...] = UNWRITTEN
        return out

    def full(self, shape, fill_value, dtype=None, **_):
        """Build an array of one value, or of one that is broadcast."""
        fill_value = settled(fill_value)
        if not _is_float(_dtype_of(fill_value) if dtype is None else dtype):
            return self.plain.full(shape, fill_value, dtype)
        out = Draft(self, np.zeros(shape))
        out[...] = fill_value
        return out

    def zeros_like(self, a, dtype=None, **_):
        """Build an array of zeros of the shape of another, and of its type."""
        return self.full_like(a, 0.0, dtype)

    def ones_like(self, a, dtype=None, **_):
        """Build an array of ones of the shape of another."""
        return self.full_like(a, 1.0, dtype)

    def empty_like(self, a, dtype=None, **_):
        """Build an array as `empty`, of the shape of another and of its type."""
        out = self.zeros_like(a, dtype)
        return self.empty(out.shape, out.dtype)

    def full_like(self, a, fill_value, dtype=None, **_):
        """Build an array of one value, of the shape of another and of its type."""
        a = self.array(a) if isinstance(a, (list, tuple)) else a
        return self.full(np.shape(a), fill_value, _dtype_of(a) if dtype is None else dtype)


class _Function:
    """A function of a namespace that does not know Drafts; arrange: numpy's, or None."""

    def __init__(self, f, arrange):
        self.f = f
        self.arrange = arrange

    def __call__(self, *args, **options):
        if self.arrange and args and isinstance(args[0], Draft):
            return args[0].arranged(self.arrange, args[1:], options)
        return _call_settled(self.f, args, options)

    def __getattr__(self, name):
        return getattr(self.f, name)


def _call_settled(f, args, options):
    """Call a function with arrays in place of Drafts."""
    names = dict(zip(options, settled(tuple(options.values())), strict=True))
    return f(*settled(args), **names)


def _computed(index):
    """Is part of an index an array of the namespace?"""
    parts = index if isinstance(index, tuple) else (index,)
    known = int, slice, list, np.ndarray, np.generic, types.NoneType, types.EllipsisType
    return not all(isinstance(i, known) for i in parts)


def _constant(value):
    """Is it a number, an array of numpy, or a nested list of such?"""
    if isinstance(value, (list, tuple)):
        return all(map(_constant, value))
    return isinstance(value, (int, float, np.number, np.ndarray))


def _is_float(dtype):
    return dtype is None or np.dtype(dtype) == np.float64


def _dtype_of(a):
    return a.dtype if hasattr(a, "dtype") else np.asarray(a).dtype
