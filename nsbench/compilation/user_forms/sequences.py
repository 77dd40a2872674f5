"""Lists and tuples in functions of a case, for numba.

numba joins tuples of arrays, and makes arrays of numbers. Here are the other forms that numpy
takes, as further versions of numpy's functions: lists of vectors, lists and tuples of numbers, and
tuples of which some members are no arrays. numba asks for them where its own do not fit. What has
no version here either, such as lists of matrices, it refuses. Importing this module registers them.
"""

from __future__ import annotations

import numpy as np
from numba.core import types
from numba.core.imputils import impl_ret_borrowed
from numba.extending import intrinsic, overload, register_jitable

UNEQUAL = "all input arrays must have the same shape"
OFF_AXIS = "the axis is out of bounds"


@intrinsic
def vector(typing_context, value):
    """Return what a function of a case returned as an array of one dimension.

    One that is such an array is returned as it is, and costs nothing to compile; of numbers, lists,
    tuples and matrices the entries become floats, in numpy's order.
    """
    if isinstance(value, types.Array) and value.ndim == 1:
        return value(value), lambda context, builder, signature, args: impl_ret_borrowed(
            context, builder, signature.return_type, args[0]
        )
    if not isinstance(value, (types.Array, types.BaseTuple, types.List, types.Number)):
        return None
    return types.float64[::1](value), lambda context, builder, signature, args: (
        context.compile_internal(builder, _entries, signature, args)
    )


def _entries(value):
    flat = np.asarray(value).ravel()
    out = np.empty(flat.size)
    for i in range(flat.size):
        out[i] = flat[i]
    return out


def _is_vector(kind):
    return isinstance(kind, types.Array) and kind.ndim == 1


def _lists_vectors(kind):
    return isinstance(kind, types.List) and _is_vector(kind.dtype)


def _lists_sequences(kind):
    """Return whether it is a list of lists or tuples, of which numba makes arrays."""
    return isinstance(kind, types.List) and isinstance(kind.dtype, (types.List, types.BaseTuple))


def _are_numbers(kind):
    members = kind.types if isinstance(kind, types.BaseTuple) else [getattr(kind, "dtype", None)]
    return isinstance(kind, (types.BaseTuple, types.List)) and all(
        isinstance(k, types.Number) for k in members
    )


def _is_mixed(kind):
    """Return whether it is a tuple with members of which numba must make arrays first."""
    return isinstance(kind, types.BaseTuple) and any(
        not isinstance(k, types.Array) for k in kind.types
    )


def _each(convert):
    """Return the function of a tuple that applies `convert` to each of its members."""

    def converted(members):
        return tuple(map(convert, members))

    @overload(converted)
    def compiled(members):
        if len(members) == 1:
            return lambda members: (convert(members[0]),)
        return lambda members: (convert(members[0]),) + converted(members[1:])

    return converted


_arrays = _each(np.asarray)
_vectors = _each(np.atleast_1d)


@register_jitable
def _rows(vectors):
    """Return the vectors of a list as the rows of a matrix."""
    size = vectors[0].size
    out = np.empty((len(vectors), size), vectors[0].dtype)
    for k in range(len(vectors)):
        row = vectors[k]
        if row.size != size:
            raise ValueError(UNEQUAL)
        for i in range(size):
            out[k, i] = row[i]
    return out


@register_jitable
def _joined(vectors):
    """Return the entries of the vectors of a list in one vector."""
    size = 0
    for k in range(len(vectors)):
        size += vectors[k].size
    out = np.empty(size, vectors[0].dtype)
    size = 0
    for k in range(len(vectors)):
        row = vectors[k]
        for i in range(row.size):
            out[size] = row[i]
            size += 1
    return out


@overload(np.array)
@overload(np.asarray)
def _of_vectors(a, dtype=None):
    """Make an array of a list or tuple of vectors; not by asarray, which in numba may be array."""
    if dtype is None and _lists_vectors(a):
        return lambda a, dtype=None: _rows(a)
    if dtype is None and isinstance(a, types.BaseTuple) and all(map(_is_vector, a)):
        return lambda a, dtype=None: np.stack(a)
    return None


@overload(np.atleast_1d)
def _atleast_1d(a):
    if isinstance(a, types.Number):
        return lambda a: np.asarray(a).ravel()
    return (lambda a: np.asarray(a)) if isinstance(a, (types.List, types.BaseTuple)) else None


@overload(np.stack)
def _stack(arrays, axis=0):
    if _are_numbers(arrays):

        def numbers(arrays, axis=0):
            if axis != 0 and axis != -1:
                raise ValueError(OFF_AXIS)
            return np.asarray(arrays)

        return numbers
    if _lists_vectors(arrays) or _lists_sequences(arrays):

        def rows(arrays, axis=0):
            matrix = np.asarray(arrays)
            if axis == 0 or axis == -2:
                return matrix
            if axis != 1 and axis != -1:
                raise ValueError(OFF_AXIS)
            return np.ascontiguousarray(matrix.T)

        return rows
    return (lambda arrays, axis=0: np.stack(_arrays(arrays), axis)) if _is_mixed(arrays) else None


@overload(np.concatenate)
def _concatenate(arrays, axis=0):
    if _lists_vectors(arrays):

        def vectors(arrays, axis=0):
            if axis != 0 and axis != -1:
                raise ValueError(OFF_AXIS)
            return _joined(arrays)

        return vectors
    if _is_mixed(arrays):
        return lambda arrays, axis=0: np.concatenate(_arrays(arrays), axis)
    return None


@overload(np.hstack)
def _hstack(tup):
    if _are_numbers(tup):
        return lambda tup: np.asarray(tup)
    if _lists_vectors(tup):
        return lambda tup: _joined(tup)
    return (lambda tup: np.hstack(_vectors(tup))) if _is_mixed(tup) else None


@overload(np.vstack)
def _vstack(tup):
    if _are_numbers(tup):
        return lambda tup: np.asarray(tup).reshape(-1, 1)
    if _lists_vectors(tup) or _lists_sequences(tup):
        return lambda tup: np.asarray(tup)
    return (lambda tup: np.vstack(_vectors(tup))) if _is_mixed(tup) else None
