"""Dual and complex numbers over ball series, and arrays of them: for partial derivatives."""

from __future__ import annotations

import numpy as np
from flint import arb

from nsbench.reference.certify.ball_series import COMPLEX, Jet, Number

# level of the derivatives that make gradients; level 1 is left for those of the whole flow
INNER = 2
SLOPES = {  # derivative of f at v, given f(v)
    "sqrt": lambda v, f: 0.5 / f,
    "exp": lambda v, f: f,
    "log": lambda v, f: v.inv(),
    "sin": lambda v, f: v.cos(),
    "cos": lambda v, f: -v.sin(),
    "atan": lambda v, f: (v * v + 1.0).inv(),
    "asin": lambda v, f: 1.0 / (1.0 - v * v).sqrt(),
    "acos": lambda v, f: -1.0 / (1.0 - v * v).sqrt(),
}


class Dual(Number):
    """Represent v + sum_j d[j] eps_j where products of eps vanish; level distinguishes nested ones
    (1, 2).
    """

    __slots__ = ("d", "level", "v")

    def __init__(self, v: Number, d: dict[int, Number], level: int = 1):
        self.v = v
        self.d = d
        self.level = level

    def lift(self, value: Number | float | arb) -> Dual:
        return Dual(value if isinstance(value, Number) else Jet.lift(None, value), {}, self.level)

    def add(self, o: Dual) -> Dual:
        d = dict(self.d)
        for j, b in o.d.items():
            d[j] = d[j] + b if j in d else b
        return Dual(self.v + o.v, d, self.level)

    def mul(self, o: Dual) -> Dual:
        d = {j: a * o.v for j, a in self.d.items()}
        for j, b in o.d.items():
            term = self.v * b
            d[j] = d[j] + term if j in d else term
        return Dual(self.v * o.v, d, self.level)

    def scaled(self, c: float) -> Dual:
        return Dual(self.v * c, {j: a * c for j, a in self.d.items()}, self.level)

    def divided(self, c: float) -> Dual:
        return Dual(self.v / c, {j: a / c for j, a in self.d.items()}, self.level)

    def inv(self) -> Dual:
        w = self.v.inv()
        slope = -(w * w)
        return Dual(w, {j: a * slope for j, a in self.d.items()}, self.level)

    def apply(self, name: str) -> Dual:
        f = self.v.apply(name)
        slope = SLOPES[name](self.v, f) if self.d else None
        return Dual(f, {j: a * slope for j, a in self.d.items()}, self.level)

    @property
    def leading(self) -> Jet:
        return self.v.leading


class Complex(Number):
    """Represent re + i im; both real numbers of any kind."""

    __slots__ = ("im", "re")
    level = COMPLEX

    def __init__(self, re: Number | float, im: Number | float):
        self.re = re
        self.im = im

    def lift(self, value: Number | complex | float) -> Complex:
        return (
            Complex(value.real, value.imag) if isinstance(value, complex) else Complex(value, 0.0)
        )

    def add(self, o: Complex) -> Complex:
        return Complex(self.re + o.re, self.im + o.im)

    def mul(self, o: Complex) -> Complex:
        return Complex(self.re * o.re - self.im * o.im, self.re * o.im + self.im * o.re)

    def scaled(self, c: float) -> Complex:
        return Complex(self.re * c, self.im * c)

    def divided(self, c: float) -> Complex:
        return Complex(self.re / c, self.im / c)

    def inv(self) -> Complex:
        size = self.re * self.re + self.im * self.im
        return Complex(self.re / size, -1.0 * self.im / size)

    def apply(self, name: str) -> Complex:
        if name != "exp":
            raise NotImplementedError(f"certificates know no complex {name}")
        from nsbench.reference.certify.array_namespace import elementary

        size = elementary("exp", self.re)
        c = elementary("cos", self.im)
        s = elementary("sin", self.im)
        return Complex(size * c, size * s)

    def conjugate(self) -> Complex:
        return Complex(self.re, -1.0 * self.im)

    def __abs__(self):
        from nsbench.reference.certify.array_namespace import elementary

        return elementary("sqrt", self.re * self.re + self.im * self.im)

    @property
    def real(self) -> Number | float:
        return self.re

    @property
    def imag(self) -> Number | float:
        return self.im

    def _compare(self, other, low):
        raise TypeError("complex numbers have no order")


class JetArray(np.ndarray):
    """Hold an object array of numbers with real and imaginary parts taken entry by entry."""

    @property
    def real(self) -> JetArray:
        return _each(self, lambda v: v.real)

    @property
    def imag(self) -> JetArray:
        return _each(self, lambda v: v.imag)

    def conj(self) -> JetArray:
        return _each(self, lambda v: v.conjugate())

    conjugate = conj


def _each(a, f):
    out = np.empty(np.shape(a), object)
    flat = out.reshape(-1)
    for k, v in enumerate(np.asarray(a, object).reshape(-1)):
        flat[k] = f(v)
    return out.view(JetArray)


def array(values) -> JetArray:
    """Convert numbers (or nested lists, arrays of them) to a JetArray."""
    return np.array(values, dtype=object).view(JetArray)
