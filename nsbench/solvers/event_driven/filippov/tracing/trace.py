"""Trace a factory: run it once on arrays of graph nodes, so that its operations become a graph.

A `Traced` looks like a float64 array. Comparisons are arrays of 0 and 1 that depend on the state of
a kink (tracing.kinks). What cannot be traced (a branch on a value, a function without recurrence)
is a TypeError that says what to write instead: such a case stays with numpy. Reductions, products
of matrices and indexing are carried out while tracing.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from nsbench.compilation.user_forms.draft_array import Draft, DraftNamespace, holds_drafts, settled
from nsbench.dynamics.array_operator_mixin import ArrayOperators
from nsbench.solvers.event_driven.filippov.tracing import kinks
from nsbench.solvers.event_driven.filippov.tracing.graph import Graph
from nsbench.solvers.event_driven.filippov.tracing.refusals import NO_NUMBER, refusal

# nodes are numbered from here in arrays: a plain integer that gets among them is recognised
BASE = 1 << 40
# numpy function -> implementation; of the last only the entries move
_ufuncs: dict[Callable, Callable] = {}
_functions: dict[Callable, Callable] = {}
_rearrangements: set[Callable] = set()


def register_numpy_functions(
    ufuncs: dict[Callable, Callable],
    functions: dict[Callable, Callable],
    rearrangements: set[Callable],
) -> None:
    """Register the functions of numpy that a Traced takes, as in interval_taylor.jet."""
    _ufuncs.update(ufuncs)
    _functions.update(functions)
    _rearrangements.update(rearrangements)


class Traced(ArrayOperators):
    """Array of graph nodes that looks like a float64 array; ids: integers BASE + node."""

    __slots__ = ("graph", "ids")

    def __init__(self, graph, ids):
        ids = np.asarray(ids)
        if ids.dtype.kind != "i" or (ids.size and int(ids.min()) < BASE):
            raise TypeError("numbers got among the nodes of a trace")
        self.graph = graph
        self.ids = ids

    shape = property(lambda self: self.ids.shape)
    ndim = property(lambda self: self.ids.ndim)
    size = property(lambda self: self.ids.size)
    T = property(lambda self: Traced(self.graph, self.ids.T))

    def __array_ufunc__(self, ufunc, method, *inputs, **kwargs):
        if holds_drafts(inputs, kwargs):
            return NotImplemented
        if (
            method == "__call__"
            and ufunc in _ufuncs
            and not any(v is not None for v in kwargs.values())
        ):
            return _ufuncs[ufunc](self.graph, *inputs)
        raise refusal(ufunc.__name__)

    def __array_function__(self, func, types, args, kwargs):
        if Draft in types:
            return NotImplemented
        if func in _functions:
            return _functions[func](*args, **kwargs)
        if func in _rearrangements:
            return Traced(self.graph, func(*[_numbered(self.graph, a) for a in args], **kwargs))
        raise refusal(func.__name__)

    def __bool__(self):
        raise TypeError("a branch on a value cannot be traced; write xp.where(c, a, b) for `if c`")

    def __float__(self):
        raise TypeError(NO_NUMBER)

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

    def __eq__(self, o):
        return np.equal(self, o)

    def __ne__(self, o):
        return np.not_equal(self, o)

    __hash__ = None

    def __mod__(self, o):
        return np.remainder(self, o)

    def __floordiv__(self, o):
        return np.floor_divide(self, o)

    def __and__(self, o):
        return np.logical_and(self, o)

    def __or__(self, o):
        return np.logical_or(self, o)

    __rand__ = __and__
    __ror__ = __or__

    def __invert__(self):
        return np.logical_not(self)

    def __len__(self):
        if not self.shape:
            raise TypeError("a traced number has no length")
        return self.shape[0]

    def __getitem__(self, index):
        return Traced(self.graph, self.ids[index])

    def __setitem__(self, index, value):
        self.ids[index] = nodes(self.graph, value)

    def reshape(self, *shape):
        return Traced(self.graph, self.ids.reshape(*shape))

    def copy(self):
        return Traced(self.graph, self.ids.copy())

    def astype(self, dtype):
        if np.dtype(dtype) != np.float64:
            raise TypeError(f"{dtype} cannot be traced")
        return self.copy()

    def __neg__(self):
        return np.negative(self)

    def sum(self, axis=None):
        return np.sum(self, axis=axis)

    def dot(self, o):
        return np.dot(self, o)

    def mean(self, axis=None):
        return np.mean(self, axis=axis)

    def max(self, axis=None):
        return np.max(self, axis=axis)

    def min(self, axis=None):
        return np.min(self, axis=axis)

    def clip(self, lo=None, hi=None):
        return np.clip(self, lo, hi)


def nodes(graph: Graph, value) -> np.ndarray:
    """Return the integer array of BASE + node of a Traced, of numbers, or of nested lists of
    both."""
    value = settled(value)
    if isinstance(value, Traced):
        return value.ids
    if isinstance(value, (list, tuple)) and any(
        isinstance(v, (Traced, list, tuple)) for v in value
    ):
        return np.stack([nodes(graph, v) for v in value])
    a = np.asarray(value)
    if a.dtype == object:
        return np.stack([nodes(graph, v) for v in a]) if a.ndim else nodes(graph, a.item())
    if a.dtype.kind not in "fiub":
        raise TypeError(f"{a.dtype} cannot be traced")
    out = np.empty(a.shape, np.int64)
    out.flat = [BASE + graph.const(v) for v in a.astype(float).ravel()]
    return out


def _numbered(graph, a):
    if isinstance(a, Traced):
        return a.ids
    if isinstance(a, (list, tuple)) and any(isinstance(v, (Traced, list, tuple)) for v in a):
        return [nodes(graph, v) for v in a]
    return a


def elementwise(method: Callable) -> Callable:
    """Return the function of arrays that applies `method(graph, *nodes)` entry by entry."""

    def f(graph, *args):
        rows = np.broadcast_arrays(*[nodes(graph, a) for a in args])
        out = np.empty(rows[0].shape, np.int64)
        out.flat = [
            BASE + method(graph, *(int(v) - BASE for v in r))
            for r in zip(*(r.ravel() for r in rows), strict=True)
        ]
        return Traced(graph, out)

    return f


def constant_table(table: np.ndarray) -> np.ndarray:
    """Return a table as an array of floats; raises TypeError for traced entries."""
    if find_traced(table) is not None:
        raise TypeError("a table of traced numbers cannot be traced; use constants")
    return np.asarray(table, float)


def _take(a, indices):
    table = constant_table(a)
    if table.ndim != 1:
        raise TypeError("take from a table of several dimensions cannot be traced; use its rows")
    return elementwise(lambda graph, i: kinks.take(graph, table, i))(indices.graph, indices)


class _Space(DraftNamespace):
    """The namespace to hand to a factory: numpy, with constructors that take traced numbers."""

    def convert(self, name, value, dtype):
        found = find_traced(value)
        if found is None:
            return super().convert(name, value, dtype)
        made = Traced(found.graph, nodes(found.graph, value))
        return made.copy() if name == "array" else made

    @staticmethod
    def take(a, indices, **kwargs):
        # numpy does not hand its function to the class of the indices
        if isinstance(indices, Traced):
            return _take(a, indices)
        return np.take(a, indices, **kwargs)


def find_traced(value) -> Traced | None:
    """Return the first Traced among nested lists, or None."""
    if isinstance(value, Traced):
        return value
    if isinstance(value, (list, tuple)):
        return next((f for v in value if (f := find_traced(v)) is not None), None)
    return None


SPACE = _Space()
def inputs(graph: Graph) -> tuple[Traced, Traced]:
    """Return time and state of a graph, as a factory's function takes them."""
    return Traced(graph, np.array(BASE + graph.n)), Traced(graph, BASE + np.arange(graph.n))


def vector(graph: Graph, value, size: int) -> list[int]:
    """Return the nodes (size,) of what a factory's function returned; TypeError if it has another
    shape."""
    ids = nodes(graph, value)
    if ids.shape != (size,):
        raise TypeError(f"shape {ids.shape} where ({size},) is needed")
    return [int(v) - BASE for v in ids]
