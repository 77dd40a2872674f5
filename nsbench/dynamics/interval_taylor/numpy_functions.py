"""Table of the functions of numpy that a Jet takes; those of REARRANGEMENTS only move entries."""

from __future__ import annotations

import numpy as np

from nsbench.dynamics.interval_taylor import arithmetic, nonsmooth
from nsbench.dynamics.interval_taylor.jet import Jet, as_jet, register_numpy_functions

UFUNCS = {
    np.add: arithmetic.add,
    np.subtract: arithmetic.subtract,
    np.multiply: arithmetic.multiply,
    np.true_divide: arithmetic.divide,
    np.power: arithmetic.power,
    np.float_power: arithmetic.power,
    np.matmul: arithmetic.matmul,
    np.negative: lambda a: -a,
    np.positive: lambda a: a.copy(),
    np.square: arithmetic.square,
    np.sqrt: lambda a: arithmetic.root(a, 0.5),
    np.reciprocal: lambda a: arithmetic.divide(1.0, a),
    np.cbrt: lambda a: arithmetic.root(a, 1.0 / 3.0),
    np.exp: arithmetic.exp,
    np.expm1: lambda a: arithmetic.subtract(arithmetic.exp(a), 1.0),
    np.log: arithmetic.log,
    np.log1p: lambda a: arithmetic.log(arithmetic.add(a, 1.0)),
    np.sin: lambda a: arithmetic.sine_and_cosine(a, -1)[0],
    np.cos: lambda a: arithmetic.sine_and_cosine(a, -1)[1],
    np.tan: arithmetic.tan,
    np.sinh: lambda a: arithmetic.sine_and_cosine(a, 1)[0],
    np.cosh: lambda a: arithmetic.sine_and_cosine(a, 1)[1],
    np.tanh: arithmetic.tanh,
    np.arctan: arithmetic.arctan,
    np.arctan2: arithmetic.arctan2,
    np.abs: lambda a: nonsmooth.maximum(a, -a),
    np.fabs: lambda a: nonsmooth.maximum(a, -a),
    np.maximum: nonsmooth.maximum,
    np.minimum: nonsmooth.minimum,
    np.fmax: nonsmooth.maximum,
    np.fmin: nonsmooth.minimum,
    np.sign: nonsmooth.sign,
    np.floor: nonsmooth.floor,
    np.mod: lambda a, b: arithmetic.subtract(
        a, arithmetic.multiply(nonsmooth.floor(arithmetic.divide(a, b)), b)
    ),
    np.hypot: lambda a, b: arithmetic.root(a * a + b * b, 0.5),
    np.heaviside: lambda a, h: arithmetic.multiply(arithmetic.add(nonsmooth.sign(a), 1.0), 0.5),
    np.less: lambda a, b: nonsmooth.compare(a, b, True),
    np.less_equal: lambda a, b: nonsmooth.compare(a, b, False),
    np.greater: lambda a, b: nonsmooth.compare(b, a, True),
    np.greater_equal: lambda a, b: nonsmooth.compare(b, a, False),
}
FUNCTIONS = {
    np.where: nonsmooth.where,
    np.sum: arithmetic.total,
    np.dot: arithmetic.matmul,
    np.linalg.norm: arithmetic.norm,
    np.clip: nonsmooth.clip,
    np.diff: arithmetic.diff,
    np.zeros_like: lambda a, **_: as_jet(np.zeros(a.shape), a.mid.shape[-2]),
    np.ones_like: lambda a, **_: as_jet(np.ones(a.shape), a.mid.shape[-2]),
    np.full_like: lambda a, v, **_: arithmetic.multiply(
        as_jet(np.ones(a.shape), a.mid.shape[-2]), v
    ),
    np.mean: lambda a, axis=None, **_: arithmetic.divide(
        arithmetic.total(a, axis), float(a.size if axis is None else a.shape[axis])
    ),
    np.max: nonsmooth.fold(nonsmooth.maximum),
    np.min: nonsmooth.fold(nonsmooth.minimum),
    np.prod: nonsmooth.fold(arithmetic.multiply),
    np.copy: lambda a, **_: a.copy(),
    np.ravel: lambda a: a.ravel(),
    np.reshape: lambda a, shape: a.reshape(shape),
    np.transpose: Jet.transpose,
    np.shape: lambda a: a.shape,
    np.ndim: lambda a: a.ndim,
    np.size: lambda a: a.size,
    np.outer: lambda a, b: arithmetic.multiply(a[:, None], b[None]),
}
REARRANGEMENTS = {
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
    np.moveaxis,
    np.swapaxes,
    np.take,
    np.atleast_1d,
    np.diag,
    np.fliplr,
    np.flipud,
}


def register() -> None:
    """Register the table with Jet."""
    register_numpy_functions(UFUNCS, FUNCTIONS, REARRANGEMENTS)
