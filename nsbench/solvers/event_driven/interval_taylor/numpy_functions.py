"""Which functions of numpy a Jet takes; those of ARRANGE only move entries."""

from __future__ import annotations

import numpy as np

from nsbench.solvers.event_driven.interval_taylor import arithmetic as algebra
from nsbench.solvers.event_driven.interval_taylor import as_jet
from nsbench.solvers.event_driven.interval_taylor import nonsmooth as kinks

UFUNCS = {
    np.add: algebra.add,
    np.subtract: algebra.subtract,
    np.multiply: algebra.multiply,
    np.true_divide: algebra.divide,
    np.power: algebra.power,
    np.float_power: algebra.power,
    np.matmul: algebra.matmul,
    np.negative: lambda a: -a,
    np.positive: lambda a: a,
    np.square: algebra.square,
    np.sqrt: lambda a: algebra._root(a, 0.5),
    np.reciprocal: lambda a: algebra.divide(1.0, a),
    np.cbrt: lambda a: algebra._root(a, 1.0 / 3.0),
    np.exp: algebra.exp,
    np.expm1: lambda a: algebra.subtract(algebra.exp(a), 1.0),
    np.log: algebra.log,
    np.log1p: lambda a: algebra.log(algebra.add(a, 1.0)),
    np.sin: lambda a: algebra._circular(a, -1)[0],
    np.cos: lambda a: algebra._circular(a, -1)[1],
    np.tan: algebra.tan,
    np.sinh: lambda a: algebra._circular(a, 1)[0],
    np.cosh: lambda a: algebra._circular(a, 1)[1],
    np.tanh: algebra.tanh,
    np.arctan: algebra.arctan,
    np.arctan2: algebra.arctan2,
    np.abs: lambda a: kinks.maximum(a, -a),
    np.fabs: lambda a: kinks.maximum(a, -a),
    np.maximum: kinks.maximum,
    np.minimum: kinks.minimum,
    np.fmax: kinks.maximum,
    np.fmin: kinks.minimum,
    np.sign: kinks.sign,
    np.floor: kinks.floor,
    np.mod: lambda a, b: algebra.subtract(
        a, algebra.multiply(kinks.floor(algebra.divide(a, b)), b)
    ),
    np.hypot: lambda a, b: algebra._root(a * a + b * b, 0.5),
    np.heaviside: lambda a, h: algebra.multiply(algebra.add(kinks.sign(a), 1.0), 0.5),
    np.less: lambda a, b: kinks._compare(a, b, True),
    np.less_equal: lambda a, b: kinks._compare(a, b, False),
    np.greater: lambda a, b: kinks._compare(b, a, True),
    np.greater_equal: lambda a, b: kinks._compare(b, a, False),
}
FUNCTIONS = {
    np.where: kinks.where,
    np.sum: algebra.total,
    np.dot: algebra.matmul,
    np.linalg.norm: algebra.norm,
    np.clip: kinks.clip,
    np.diff: algebra.diff,
    np.zeros_like: lambda a, **_: as_jet(np.zeros(a.shape), a.mid.shape[-2]),
    np.ones_like: lambda a, **_: as_jet(np.ones(a.shape), a.mid.shape[-2]),
    np.full_like: lambda a, v, **_: algebra.multiply(as_jet(np.ones(a.shape), a.mid.shape[-2]), v),
    np.mean: lambda a, axis=None, **_: algebra.divide(
        algebra.total(a, axis), float(a.size if axis is None else a.shape[axis])
    ),
    np.max: kinks._fold(kinks.maximum),
    np.min: kinks._fold(kinks.minimum),
    np.prod: kinks._fold(algebra.multiply),
    np.copy: lambda a, **_: a.copy(),
    np.shape: lambda a: a.shape,
    np.ndim: lambda a: a.ndim,
    np.size: lambda a: a.size,
    np.outer: lambda a, b: algebra.multiply(a[:, None], b[None]),
}
ARRANGE = {
    np.stack,
    np.concatenate,
    np.hstack,
    np.vstack,
    np.column_stack,
    np.append,
    np.roll,
    np.flip,
    np.tile,
    np.repeat,
    np.expand_dims,
    np.squeeze,
    np.broadcast_to,
    np.transpose,
    np.moveaxis,
    np.swapaxes,
    np.ravel,
    np.reshape,
    np.take,
    np.atleast_1d,
    np.diag,
    np.fliplr,
    np.flipud,
}
