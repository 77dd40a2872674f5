"""Functions of numpy on traced arrays: each works on single traced values, or on whole arrays."""

from __future__ import annotations

import numpy as np

from nsbench.solvers.event_driven.filippov.tracing import kinks
from nsbench.solvers.event_driven.filippov.tracing.graph import Graph
from nsbench.solvers.event_driven.filippov.tracing.trace import (
    Traced,
    constant_table,
    elementwise,
    find_traced,
    nodes,
    register_numpy_functions,
)


def _sum(a, axis=None, **_):
    ids = a.ids.reshape(-1) if axis is None else np.moveaxis(a.ids, axis, 0)
    if not len(ids):
        return Traced(a.graph, nodes(a.graph, np.zeros(ids.shape[1:])))
    out = Traced(a.graph, ids[0].copy())
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
        out = rows[0].copy()
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
    found = find_traced([condition, *choices])
    return elementwise(kinks.choose)(found.graph, condition, *choices)


def _select(conditions, choices, default=0.0):
    out = default
    for condition, choice in zip(reversed(conditions), reversed(choices), strict=True):
        out = _where(condition, choice, out)
    return out


def _interp(x, xp, fp, left=None, right=None, period=None):
    points = constant_table(xp)
    values = constant_table(fp)
    if period is not None:
        order = np.argsort(points % period)
        points, values = (points % period)[order], values[order]
        points = np.concatenate((points[-1:] - period, points, points[:1] + period))
        values = np.concatenate((values[-1:], values, values[:1]))
        x = np.remainder(x, float(period))
    f = lambda graph, a: kinks.interpolate(graph, a, points, values, (left, right))
    return elementwise(f)(x.graph, x)


def _searchsorted(a, v, side="left", sorter=None):
    table = constant_table(a)
    return elementwise(lambda graph, i: kinks.search(graph, table, i))(v.graph, v)


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
    name: elementwise(f)
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
        np.floor: kinks.floor,
        np.ceil: lambda g, a: g.neg(kinks.floor(g, g.neg(a), "ceil")),
        np.rint: lambda g, a: kinks.floor(g, g.add(a, _half(g)), "rint"),
        np.remainder: kinks.remainder,
        np.floor_divide: lambda g, a, b: kinks.floor(g, g.div(a, b), "floor_divide"),
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


register_numpy_functions(UFUNCS, FUNCTIONS, ARRANGE)
