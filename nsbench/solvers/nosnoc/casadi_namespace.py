"""Array namespace of casadi expressions, to hand to the factories of a case.

numpy arrays of Symbols do the indexing, stacking and products; what numpy would ask a number for
(sin, sqrt, ...) the Symbol answers with an expression. Symbol itself is no sequence and leaves
products with arrays to numpy, which casadi's own types do not.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from casadi import MX, SX

FUNCTIONS = ("sin", "cos", "tan", "exp", "log", "sqrt", "sinh", "cosh", "tanh")
INVERSE = {"arcsin": "asin", "arccos": "acos", "arctan": "atan"}


class Symbol:
    """A scalar casadi expression e."""

    __slots__ = ("e",)

    def __init__(self, e):
        self.e = e

    def __neg__(self):
        return Symbol(-self.e)

    def __abs__(self):
        import casadi

        return Symbol(casadi.fabs(self.e))

    def __bool__(self):
        raise TypeError(
            "an expression has no truth value: use the array namespace's where, maximum or minimum"
        )

    def __float__(self):
        raise TypeError("an expression is no number: the function leaves the array namespace")


def _binary(name):
    def op(self: Symbol, other: Symbol | float | np.ndarray) -> Symbol:
        if isinstance(other, np.ndarray):
            return NotImplemented  # numpy then does it entry by entry
        return Symbol(getattr(self.e, name)(plain(other)))

    return op


for _name in ("add", "radd", "sub", "rsub", "mul", "rmul", "truediv", "rtruediv", "pow", "rpow"):
    setattr(Symbol, f"__{_name}__", _binary(f"__{_name}__"))
for _name in ("gt", "ge", "lt", "le"):
    setattr(Symbol, f"__{_name}__", _binary(f"__{_name}__"))
for _name in FUNCTIONS:
    setattr(Symbol, _name, lambda self, name=_name: Symbol(getattr(self.e, name)()))
for _name, _own in INVERSE.items():
    setattr(Symbol, _name, lambda self, name=_own: Symbol(_function(name, self.e)))


def _function(name, *args):
    import casadi

    return getattr(casadi, name)(*args)


def plain(value: Symbol | float) -> SX | MX | float:
    """The expression of a Symbol, or the float of a number."""
    return value.e if isinstance(value, Symbol) else float(value)


def _entrywise(f):
    """Build the function of arrays that applies f entry by entry, as numpy's functions do.

    f: of casadi expressions or numbers, one from each argument -> an expression. The result takes
    arrays of Symbols or numbers, broadcast against one another, and returns an array (dtype object)
    of Symbols of the common shape, or one Symbol if all are scalars. casadi's own functions know
    columns and matrices only, and numpy's cannot compare Symbols: hence the loop over entries.
    """

    def g(*args: Symbol | float | np.ndarray) -> Symbol | np.ndarray:
        arrays = np.broadcast_arrays(*(np.asarray(a, object) for a in args))
        out = np.empty(arrays[0].shape, object)
        for k in np.ndindex(out.shape):
            out[k] = Symbol(f(*(plain(a[k]) for a in arrays)))
        return out if out.ndim else out[()]

    return g


class Namespace:
    """numpy, with the functions that compare written as expressions."""

    __name__ = "casadi"
    maximum = staticmethod(_entrywise(lambda a, b: _function("fmax", a, b)))
    minimum = staticmethod(_entrywise(lambda a, b: _function("fmin", a, b)))
    sign = staticmethod(_entrywise(lambda a: _function("sign", a)))
    hypot = staticmethod(_entrywise(lambda a, b: _function("sqrt", a * a + b * b)))
    where = staticmethod(_entrywise(lambda c, a, b: _function("if_else", c, a, b)))
    arctan2 = staticmethod(_entrywise(lambda a, b: _function("atan2", a, b)))

    def __getattr__(self, name):
        return getattr(np, name)


def vector(column: SX | MX) -> np.ndarray:
    """(n,) array of Symbols from a casadi column."""
    out = np.empty(column.shape[0], object)
    for i in range(len(out)):
        out[i] = Symbol(column[i])
    return out


def column(values: np.ndarray) -> SX | MX:
    """casadi column of what a factory's function returned."""
    import casadi

    return casadi.vertcat(*(plain(v) for v in np.asarray(values, object).ravel()))
