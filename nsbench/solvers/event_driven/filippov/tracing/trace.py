"""Trace a factory: run it once on arrays of graph nodes, so that its operations become a graph.

A `Traced` looks like a float64 array. What cannot be traced (a branch on a value, kinks, a function
without recurrence) is a TypeError: such a case stays with numpy. Reductions, products of matrices
and indexing are carried out while tracing.
"""

from __future__ import annotations

import numpy as np

from nsbench.solvers.event_driven.array_operator_mixin import ArrayOperators
from nsbench.solvers.event_driven.filippov.tracing.graph import Graph

# nodes are numbered from here in arrays: a plain integer that gets among them is recognised
BASE = 1 << 40


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
        if (
            method == "__call__"
            and ufunc in UFUNCS
            and not any(v is not None for v in kwargs.values())
        ):
            return UFUNCS[ufunc](self.graph, *inputs)
        raise TypeError(f"{ufunc.__name__} cannot be traced")

    def __array_function__(self, func, types, args, kwargs):
        if func in FUNCTIONS:
            return FUNCTIONS[func](*args, **kwargs)
        if func in ARRANGE:
            return Traced(self.graph, func(*[_numbered(self.graph, a) for a in args], **kwargs))
        raise TypeError(f"{func.__name__} cannot be traced")

    def __bool__(self):
        raise TypeError("a traced number has no truth value")

    def __float__(self):
        raise TypeError("a traced number is no float")

    def __len__(self):
        if not self.shape:
            raise TypeError("a traced number has no length")
        return self.shape[0]

    def __getitem__(self, index):
        return Traced(self.graph, self.ids[index])

    def __setitem__(self, index, value):
        self.ids = self.ids.copy()
        self.ids[index] = nodes(self.graph, value)

    def reshape(self, *shape):
        return Traced(self.graph, self.ids.reshape(*shape))

    def copy(self):
        return Traced(self.graph, self.ids.copy())

    def astype(self, dtype):
        if np.dtype(dtype) != np.float64:
            raise TypeError(f"{dtype} cannot be traced")
        return self

    def __neg__(self):
        return np.negative(self)

    def sum(self, axis=None):
        return _sum(self, axis)

    def dot(self, o):
        return _product(self, o)


def nodes(graph: Graph, value) -> np.ndarray:
    """Return the integer array of BASE + node of a Traced, of numbers, or of nested lists of
    both."""
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


def _elementwise(method):
    def f(graph, *args):
        rows = np.broadcast_arrays(*[nodes(graph, a) for a in args])
        out = np.empty(rows[0].shape, np.int64)
        out.flat = [
            BASE + method(graph, *(int(v) - BASE for v in r))
            for r in zip(*(r.ravel() for r in rows), strict=True)
        ]
        return Traced(graph, out)

    return f


def _sum(a, axis=None, **_):
    ids = a.ids.reshape(-1) if axis is None else np.moveaxis(a.ids, axis, 0)
    if not len(ids):
        return Traced(a.graph, nodes(a.graph, np.zeros(ids.shape[1:])))
    out = Traced(a.graph, ids[0])
    for row in ids[1:]:
        out = out + Traced(a.graph, row)
    return out


def _product(a, b):
    """a @ b for vectors and matrices."""
    graph = a.graph if isinstance(a, Traced) else b.graph
    a = Traced(graph, nodes(graph, a))
    b = Traced(graph, nodes(graph, b))
    if a.ndim == 1:
        return _sum(a * b if b.ndim == 1 else a[:, None] * b, 0)
    if a.ndim == 2 and b.ndim in (1, 2):
        return _sum(a * b[None], 1) if b.ndim == 1 else _sum(a[:, :, None] * b[None], 1)
    raise TypeError("this product cannot be traced")


def _norm(a, ord=None, axis=None, **_):
    if ord not in (None, 2) or (axis is None and a.ndim > 1):
        raise TypeError("this norm cannot be traced")
    return np.sqrt(_sum(a * a, axis))


def _mean(a, axis=None, **_):
    return _sum(a, axis) / float(a.size if axis is None else a.shape[axis])


def _filled(a, value):
    return Traced(a.graph, nodes(a.graph, np.full(a.shape, value)))


_one = lambda g: g.const(1.0)
_half = lambda g: g.const(0.5)
UFUNCS = {
    name: _elementwise(f)
    for name, f in {
        np.add: Graph.add,
        np.subtract: Graph.sub,
        np.multiply: Graph.mul,
        np.true_divide: Graph.div,
        np.power: Graph.power,
        np.float_power: Graph.power,
        np.negative: Graph.neg,
        np.positive: lambda g, a: a,
        np.square: Graph.square,
        np.sqrt: lambda g, a: g.power(a, _half(g)),
        np.reciprocal: lambda g, a: g.div(_one(g), a),
        np.exp: Graph.exp,
        np.log: Graph.log,
        np.sin: Graph.sin,
        np.cos: Graph.cos,
        np.tan: lambda g, a: g.div(g.sin(a), g.cos(a)),
        np.sinh: Graph.sinh,
        np.cosh: Graph.cosh,
        np.tanh: Graph.tanh,
        np.arctan: Graph.arctan,
        np.hypot: lambda g, a, b: g.power(g.add(g.square(a), g.square(b)), _half(g)),
    }.items()
} | {np.matmul: lambda g, a, b: _product(a, b)}
FUNCTIONS = {
    np.sum: _sum,
    np.dot: _product,
    np.linalg.norm: _norm,
    np.mean: _mean,
    np.copy: lambda a, **_: a.copy(),
    np.zeros_like: lambda a, **_: _filled(a, 0.0),
    np.ones_like: lambda a, **_: _filled(a, 1.0),
    np.full_like: lambda a, v, **_: _filled(a, float(v)),
    np.diff: lambda a: a[1:] - a[:-1],
    np.shape: lambda a: a.shape,
    np.ndim: lambda a: a.ndim,
    np.size: lambda a: a.size,
    np.outer: lambda a, b: Traced(*_column(a, b)) * b,
}
ARRANGE = {
    np.stack,
    np.concatenate,
    np.hstack,
    np.vstack,
    np.column_stack,
    np.roll,
    np.flip,
    np.tile,
    np.repeat,
    np.take,
    np.expand_dims,
    np.squeeze,
    np.broadcast_to,
    np.transpose,
    np.moveaxis,
    np.swapaxes,
    np.ravel,
    np.reshape,
    np.atleast_1d,
    np.fliplr,
    np.flipud,
}


def _column(a, b):
    graph = a.graph if isinstance(a, Traced) else b.graph
    return graph, nodes(graph, a)[:, None]


class _Space:
    """The namespace to hand to a factory: numpy, with constructors that take traced numbers."""

    __name__ = "numpy"

    def __getattr__(self, name):
        return getattr(np, name)

    @staticmethod
    def array(value, dtype=None):
        return _made(value, np.array)

    @staticmethod
    def asarray(value, dtype=None):
        return _made(value, np.asarray)


def _made(value, make):
    found = _first(value)
    return make(value) if found is None else Traced(found.graph, nodes(found.graph, value))


def _first(value):
    if isinstance(value, Traced):
        return value
    if isinstance(value, (list, tuple)):
        return next((f for v in value if (f := _first(v)) is not None), None)
    return None


SPACE = _Space()
UNTRACEABLE = (
    TypeError,
    ValueError,
    AttributeError,
    IndexError,
    NotImplementedError,
    OverflowError,
    ZeroDivisionError,
)


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
