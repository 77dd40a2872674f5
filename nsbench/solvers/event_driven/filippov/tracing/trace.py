"""Trace a factory: run it once on arrays of graph nodes, so that its operations become a graph.

A `Traced` looks like a float64 array. Comparisons are arrays of 0 and 1 that depend on the state of
a kink (tracing.kinks). What cannot be traced (a branch on a value, a function without recurrence)
is a TypeError that says what to write instead: such a case stays with numpy. Reductions, products
of matrices and indexing are carried out while tracing.
"""

from __future__ import annotations

import re

import numpy as np

from nsbench.solvers.event_driven.array_operator_mixin import ArrayOperators
from nsbench.solvers.event_driven.filippov.tracing import kinks
from nsbench.solvers.event_driven.filippov.tracing.graph import Graph

# nodes are numbered from here in arrays: a plain integer that gets among them is recognised
BASE = 1 << 40
NO_NUMBER = (
    "a function of plain numbers, as those of math or scipy, cannot be traced; write functions of "
    "xp, for a spline xp.searchsorted and xp.take"
)
SMOOTH = "write it with sqrt, exp, log, sin, cos, tan, sinh, cosh, tanh and arctan"
PERIODIC = "it has a jump in every period; write those of the run with xp.where or xp.interp"
# what to write for functions of numpy that cannot be traced
REMEDIES = {
    "equal": "write < or >: equality holds for no length of time",
    "not_equal": "write < or >: equality holds for no length of time",
    **dict.fromkeys(
        ("floor", "ceil", "rint", "trunc", "fmod", "remainder", "floor_divide"), PERIODIC
    ),
    **dict.fromkeys(("arcsinh", "arccosh", "arctanh", "cbrt"), SMOOTH),
    "arctan2": "write arctan, as in 2 * xp.arctan(y / (xp.hypot(x, y) + x)) for arctan2(y, x)",
    "sort": "write xp.minimum and xp.maximum of the entries",
}


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
        raise refusal(ufunc.__name__)

    def __array_function__(self, func, types, args, kwargs):
        if func in FUNCTIONS:
            return FUNCTIONS[func](*args, **kwargs)
        if func in ARRANGE:
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

    def mean(self, axis=None):
        return _mean(self, axis)

    def max(self, axis=None):
        return np.max(self, axis=axis)

    def min(self, axis=None):
        return np.min(self, axis=axis)

    def clip(self, lo=None, hi=None):
        return _clip(self, lo, hi)


def refusal(name: str) -> TypeError:
    """Return the error of a function of numpy that cannot be traced, with what to write instead."""
    remedy = REMEDIES.get(name)
    return TypeError(f"{name} cannot be traced" + (f"; {remedy}" if remedy else ""))


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


def _fold(pick):
    """Return a reduction along an axis, as np.max, from a function of two arrays."""

    def fold(a, axis=None, **_):
        rows = a.reshape(-1) if axis is None else np.moveaxis(a, axis, 0)
        out = rows[0]
        for k in range(1, len(rows)):
            out = pick(out, rows[k])
        return out

    return fold


def _clip(a, lo=None, hi=None, **_):
    a = a if lo is None else np.maximum(a, lo)
    return a if hi is None else np.minimum(a, hi)


def _where(condition, *choices):
    if len(choices) != 2:
        raise TypeError("where without two values cannot be traced; write xp.where(c, a, b)")
    found = _first([condition, *choices])
    return _elementwise(kinks.choose)(found.graph, condition, *choices)


def _select(conditions, choices, default=0.0):
    out = default
    for condition, choice in zip(reversed(conditions), reversed(choices), strict=True):
        out = _where(condition, choice, out)
    return out


def _numbers(table):
    if _first(table) is not None:
        raise TypeError("a table of traced numbers cannot be traced; use constants")
    return np.asarray(table, float)


def _interp(x, xp, fp, left=None, right=None, period=None):
    if period is not None:
        raise TypeError(f"interp with a period cannot be traced; {PERIODIC}")
    points = _numbers(xp)
    values = _numbers(fp)
    f = lambda graph, a: kinks.interpolate(graph, a, points, values, (left, right))
    return _elementwise(f)(x.graph, x)


def _searchsorted(a, v, side="left", sorter=None):
    table = _numbers(a)
    return _elementwise(lambda graph, i: kinks.search(graph, table, i))(v.graph, v)


def _take(a, indices, axis=None, **_):
    table = _numbers(a)
    if table.ndim != 1:
        raise TypeError("take from a table of several dimensions cannot be traced; use its rows")
    return _elementwise(lambda graph, i: kinks.take(graph, table, i))(indices.graph, indices)


def _cumsum(a, axis=None, **_):
    rows = a.reshape(-1) if axis is None else np.moveaxis(a, axis, 0)
    sums = [rows[0]]
    for k in range(1, len(rows)):
        sums.append(sums[-1] + rows[k])
    return np.stack(sums, axis=axis or 0)


def _filled(a, value):
    return Traced(a.graph, nodes(a.graph, np.full(a.shape, value)))


_one = lambda g: g.const(1.0)
_arcsin = lambda g, a: g.arctan(g.div(a, g.power(g.sub(_one(g), g.square(a)), _half(g))))
_and = lambda g, a, b: kinks.choose(g, a, b, g.const(0.0))
_or = lambda g, a, b: kinks.choose(g, a, _one(g), b)
_not = lambda g, a: kinks.choose(g, a, g.const(0.0), _one(g))
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
        np.log2: lambda g, a: g.mul(g.const(1.0 / np.log(2.0)), g.log(a)),
        np.log10: lambda g, a: g.mul(g.const(1.0 / np.log(10.0)), g.log(a)),
        np.log1p: lambda g, a: g.log(g.add(a, _one(g))),
        np.expm1: lambda g, a: g.sub(g.exp(a), _one(g)),
        np.arcsin: _arcsin,
        np.arccos: lambda g, a: g.sub(g.const(0.5 * np.pi), _arcsin(g, a)),
        np.sin: Graph.sin,
        np.cos: Graph.cos,
        np.tan: lambda g, a: g.div(g.sin(a), g.cos(a)),
        np.sinh: Graph.sinh,
        np.cosh: Graph.cosh,
        np.tanh: Graph.tanh,
        np.arctan: Graph.arctan,
        np.hypot: lambda g, a, b: g.power(g.add(g.square(a), g.square(b)), _half(g)),
        np.abs: kinks.absolute,
        np.fabs: kinks.absolute,
        np.sign: kinks.sign,
        np.heaviside: kinks.heaviside,
        np.maximum: kinks.maximum,
        np.minimum: kinks.minimum,
        np.fmax: kinks.maximum,
        np.fmin: kinks.minimum,
        np.greater: lambda g, a, b: kinks.greater(g, a, b, ">"),
        np.greater_equal: lambda g, a, b: kinks.greater(g, a, b, ">="),
        np.less: lambda g, a, b: kinks.greater(g, b, a, "<"),
        np.less_equal: lambda g, a, b: kinks.greater(g, b, a, "<="),
        np.logical_and: _and,
        np.logical_or: _or,
        np.logical_not: _not,
        np.bitwise_and: _and,
        np.bitwise_or: _or,
        np.invert: _not,
    }.items()
} | {np.matmul: lambda g, a, b: _product(a, b)}
FUNCTIONS = {
    np.sum: _sum,
    np.dot: _product,
    np.linalg.norm: _norm,
    np.mean: _mean,
    np.cumsum: _cumsum,
    np.max: _fold(np.maximum),
    np.min: _fold(np.minimum),
    np.any: _fold(np.logical_or),
    np.all: _fold(np.logical_and),
    np.clip: _clip,
    np.where: _where,
    np.select: _select,
    np.interp: _interp,
    np.searchsorted: _searchsorted,
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

    @staticmethod
    def take(a, indices, **kwargs):
        # numpy does not hand its function to the class of the indices
        if isinstance(indices, Traced):
            return _take(a, indices, **kwargs)
        return np.take(a, indices, **kwargs)


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


def describe_refusal(error: Exception) -> str:
    """Say what of a case cannot be traced and what to write instead, with the line of its file."""
    places = kinks.failing_places(error)
    line = kinks.user_line(places)
    text = str(error)
    if not (places[-1].inner or line == str(places[-1])):
        text = NO_NUMBER
    if isinstance(error, IndexError) and "valid indices" in text:
        text = "an index cannot be traced; write xp.take(table, j) for table[j]"
    method = re.fullmatch("'Traced' object has no attribute '(.*)'", text)
    if method:
        text = f"the method {method[1]} of arrays cannot be traced; write the function of xp"
    return f"{line}: {text}" if line else text


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
