"""Array namespace of certificates: given to a factory in place of numpy, for arrays of ball series.

Kinks of a drift (maximum, minimum, abs, clip, where) are decided once per step: `Branches` records
every comparison with the number that decides it, so that the integrator can end the step where that
number changes its sign.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nsbench.reference.certify.ball_series import ROUNDING, Jet, NotDecided, Number
from nsbench.reference.certify.dual_numbers import Complex, JetArray, _each, array

Operand = np.ndarray | Number | float  # an argument of the functions that work entry by entry
ELEMENTWISE = {
    "sin": "sin",
    "cos": "cos",
    "tan": "tan",
    "exp": "exp",
    "log": "log",
    "sqrt": "sqrt",
    "sinh": "sinh",
    "cosh": "cosh",
    "tanh": "tanh",
    "arctan": "arctan",
    "arcsin": "arcsin",
    "arccos": "arccos",
}


class Branches:
    """Record the comparisons of one evaluation in order: choices (decided at the first one, kept
    later), deciders (jets).
    """

    def __init__(self, choices=None):
        self.choices = list(choices or ())
        self.fixed = choices is not None
        self.deciders: list[Number] = []

    def ask(self, number: Number, low: bool) -> bool:
        """Is the number positive just after its time (at zero: `low`)?"""
        k = len(self.deciders)
        self.deciders.append(number)
        if not self.fixed:
            self.choices.append(sign_after(number.leading, low))
        return self.choices[k]


def sign_after(jet: Jet, low: bool) -> bool:
    """Is a series positive for small positive times? The first coefficient that is not zero
    decides.
    """
    for k in range(min(jet.length, 6)):
        c = jet.at(k)
        if c > 0 and float(c.mid()) > ROUNDING:
            return True
        if c < 0 and float(c.mid()) < -ROUNDING:
            return False
        if not abs(c) < ROUNDING:
            raise NotDecided(
                "a kink of the drift cannot be decided: the state is not known well enough"
            )
    return low


class _Current:
    """Hold the branches in which comparisons are recorded now."""

    branches: Branches | None = None


def watching(branches: Branches | None) -> Branches | None:
    """Record comparisons in `branches` from now on; return the former branches."""
    old = _Current.branches
    _Current.branches = branches
    return old


def decide(difference: Number | float, low: bool) -> bool:
    """Decide the sign of a number of any kind through the current branches; balls alone decide
    without them.
    """
    number = difference if isinstance(difference, Number) else Jet.lift(None, difference)
    if _Current.branches is not None:
        return _Current.branches.ask(number, low)
    return sign_after(number.leading, low)


def noted() -> list[Number]:
    """List the numbers that have decided the comparisons so far."""
    return _Current.branches.deciders if _Current.branches is not None else []


def elementary(name: str, value: Number | float) -> Number:
    """Evaluate an elementary function of a number or a plain float, rounded
    outwards in both cases.
    """
    return getattr(value if isinstance(value, Number) else Jet.lift(None, value), name)()


def _maximum(a, b):
    return a if _is_ge(a, b) else b


def _minimum(a, b):
    return b if _is_ge(a, b) else a


def _is_ge(a, b):
    return decide(a - b, True) if isinstance(a, Number) or isinstance(b, Number) else a >= b


def _pairwise(f):
    """Lift a function of two numbers to arrays."""

    def g(a: Operand, b: Operand) -> JetArray | Number | float:
        a, b = np.broadcast_arrays(np.asarray(a, object), np.asarray(b, object))
        out = np.empty(a.shape, object)
        for k in np.ndindex(a.shape):
            out[k] = f(a[k], b[k])
        return out.view(JetArray) if out.ndim else out[()]

    return g


def _one(f):
    """Lift a function of one number to arrays."""

    def g(a: Operand) -> JetArray | Number | float:
        return (
            _each(a, f)
            if isinstance(a, np.ndarray) and a.ndim
            else f(a if not isinstance(a, np.ndarray) else a[()])
        )

    return g


class Taylor:
    """Provide numpy's functions by name. Constants stay floats; what depends on state or time is an
    array of numbers.
    """

    __name__ = "taylor"
    pi = np.pi
    e = np.e
    inf = np.inf
    newaxis = np.newaxis
    float64 = np.float64
    complex128 = np.complex128
    maximum = staticmethod(_pairwise(_maximum))
    minimum = staticmethod(_pairwise(_minimum))
    hypot = staticmethod(_pairwise(lambda a, b: elementary("sqrt", a * a + b * b)))
    abs = absolute = staticmethod(_one(abs))
    conj = conjugate = staticmethod(_one(lambda v: v.conjugate()))
    real = staticmethod(_one(lambda v: v.real))
    imag = staticmethod(_one(lambda v: v.imag))
    square = staticmethod(lambda a: a * a)
    sign = staticmethod(_one(lambda v: 1.0 if _is_ge(v, 0.0) else -1.0))
    add = staticmethod(lambda a, b: a + b)
    subtract = staticmethod(lambda a, b: a - b)
    multiply = staticmethod(lambda a, b: a * b)
    divide = true_divide = staticmethod(lambda a, b: a / b)
    negative = staticmethod(lambda a: -a)
    power = staticmethod(lambda a, b: a**b)

    @staticmethod
    def where(condition: np.ndarray | bool, a: Operand, b: Operand) -> JetArray:
        return _pairwise3(np.asarray(condition, object), a, b)

    @staticmethod
    def clip(a: Operand, low: Operand, high: Operand) -> JetArray | Number | float:
        return Taylor.minimum(Taylor.maximum(a, low), high)

    @staticmethod
    def array(values: Sequence, dtype: object = None) -> JetArray:
        return array(_plain(values))

    asarray = array

    @staticmethod
    def zeros(shape: int | tuple[int, ...], dtype: object = None) -> JetArray:
        return np.full(shape, 0.0, object).view(JetArray)

    @staticmethod
    def ones(shape: int | tuple[int, ...], dtype: object = None) -> JetArray:
        return np.full(shape, 1.0, object).view(JetArray)

    @staticmethod
    def full(shape: int | tuple[int, ...], value: Number | float, dtype: object = None) -> JetArray:
        return np.full(shape, value, object).view(JetArray)

    @staticmethod
    def zeros_like(a: np.ndarray, dtype: object = None) -> JetArray:
        return Taylor.zeros(np.shape(a))

    empty = zeros
    empty_like = zeros_like

    @staticmethod
    def ones_like(a: np.ndarray, dtype: object = None) -> JetArray:
        return Taylor.ones(np.shape(a))

    @staticmethod
    def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray | Number | float:
        return np.asarray(a, object) @ np.asarray(b, object)

    matmul = dot

    def __getattr__(self, name):
        if name in ELEMENTWISE:
            return _one(lambda v: elementary(ELEMENTWISE[name], v))
        if name in SHAPES:
            return lambda *args, **kwargs: _view(getattr(np, name)(*map(_objects, args), **kwargs))
        if name.startswith("__"):
            raise AttributeError(name)
        raise NotImplementedError(
            f"certificates know no array function {name!r}: the case cannot be certified"
        )


SHAPES = (
    "stack",
    "concatenate",
    "sum",
    "cumsum",
    "reshape",
    "ravel",
    "transpose",
    "tile",
    "repeat",
    "roll",
    "flip",
    "diff",
    "outer",
    "eye",
    "arange",
    "einsum",
    "atleast_1d",
    "expand_dims",
    "squeeze",
    "hstack",
    "vstack",
    "column_stack",
    "broadcast_to",
    "mean",
    "prod",
    "linspace",
    "take",
    "split",
    "diag",
    "triu_indices",
    "inner",
)


def _objects(a):
    if isinstance(a, np.ndarray) and a.dtype == object:
        return a
    return (
        type(a)(map(_objects, a))
        if isinstance(a, (list, tuple)) and any(isinstance(v, (np.ndarray, Number)) for v in a)
        else a
    )


def _view(a):
    return a.view(JetArray) if isinstance(a, np.ndarray) and a.dtype == object else a


def _plain(values):
    """Flatten lists of numbers and of arrays of one number, as in xp.array([x[0:1], ...])."""
    return [_plain(v) for v in values] if isinstance(values, (list, tuple)) else values


def _pairwise3(condition, a, b):
    condition, a, b = np.broadcast_arrays(condition, np.asarray(a, object), np.asarray(b, object))
    out = np.empty(condition.shape, object)
    for k in np.ndindex(condition.shape):
        out[k] = a[k] if condition[k] else b[k]
    return out.view(JetArray) if out.ndim else out[()]


NAMESPACE = Taylor()


def vector(values, n: int) -> list:
    """Convert what a factory's function returned to a list of n numbers; raise ValueError for
    another shape.
    """
    out = np.asarray(values, object).reshape(-1)
    if out.size != n:
        raise ValueError(
            f"a factory returned {out.size} entries in the certificate's namespace; {n} are needed"
        )
    if any(isinstance(v, (Complex, complex)) and not isinstance(v, float) for v in out):
        raise ValueError("a factory returned complex numbers; real ones are needed")
    return [v if isinstance(v, Number) else Jet.lift(None, v) for v in out]
