"""Operators of array-like classes, carried out by numpy's functions.

numpy hands its functions to a class with `__array_ufunc__` and `__array_function__`; this mixin
makes the operators call them. Shared by Jet (event_driven.interval_taylor) and Traced
(event_driven.filippov.tracing).
"""

from __future__ import annotations

from typing import Self

import numpy as np


class ArrayOperators:
    """Arithmetic operators, iteration and flattening of a class that looks like a float64 array.

    The class has shape, __getitem__, reshape and copy.
    """

    __slots__ = ()
    dtype = np.dtype(np.float64)

    def __iter__(self):
        return (self[k] for k in range(len(self)))

    def ravel(self) -> Self:
        """Return the entries in one dimension."""
        return self.reshape(-1)

    def flatten(self) -> Self:
        """Return a copy in one dimension."""
        return self.ravel().copy()

    def __pos__(self):
        return self.copy()

    def __add__(self, o):
        return np.add(self, o)

    def __radd__(self, o):
        return np.add(o, self)

    def __sub__(self, o):
        return np.subtract(self, o)

    def __rsub__(self, o):
        return np.subtract(o, self)

    def __mul__(self, o):
        return np.multiply(self, o)

    def __rmul__(self, o):
        return np.multiply(o, self)

    def __truediv__(self, o):
        return np.true_divide(self, o)

    def __rtruediv__(self, o):
        return np.true_divide(o, self)

    def __pow__(self, o):
        return np.power(self, o)

    def __rpow__(self, o):
        return np.power(o, self)

    def __matmul__(self, o):
        return np.matmul(self, o)

    def __rmatmul__(self, o):
        return np.matmul(o, self)
