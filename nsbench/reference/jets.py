"""Numbers a drift can be evaluated in: power series in time with ball coefficients, with partial derivatives, complex.

Jet is a truncated series a_0 + a_1 s + ... + O(s^L) whose coefficients are balls (python-flint's arb_series): every
operation rounds outwards, so what is true of a ball is true of every number in it. Dual carries partial derivatives
with it (forward mode, sparse); Complex is a pair. All three nest: a Dual of Jets has Jets as value and derivatives.

Source: Johansson, "Arb: efficient arbitrary-precision midpoint-radius interval arithmetic", IEEE Trans. Comput. 66
(2017); Griewank and Walther, "Evaluating Derivatives" (2008), chapters 3 and 13.
"""
from __future__ import annotations

import numbers

import numpy as np
from flint import arb, arb_series

ROUNDING = 1e-25        # a ball this close to zero counts as zero when the side of a kink must be told


class NotDecided(ArithmeticError):
    """A comparison of balls that overlap: the answer differs within the ball."""


def exact(value) -> arb:
    """A float, an integer or an arb as an arb without rounding."""
    return value if isinstance(value, arb) else arb(float(value))


class Number:
    """What the kinds of numbers share: operators with arrays and plain numbers on either side.

    A kind gives level (numbers of a lower level are constants to it), lift(constant), add, mul, neg, inv, the
    elementary functions through `apply`, and `leading` (the number whose sign decides a comparison).
    """
    __slots__ = ()

    def _other(self, other):
        """`other` as a number of this kind; NotImplemented for arrays and numbers of a higher level."""
        if isinstance(other, Number):
            if other.level > self.level:
                return NotImplemented
            return other if other.level == self.level else self.lift(other)
        if isinstance(other, complex) and not isinstance(other, numbers.Real):
            return NotImplemented if self.level < Complex.level else Complex(other.real, other.imag)
        return self.lift(other) if isinstance(other, (numbers.Real, arb)) else NotImplemented

    def __add__(self, other):
        o = self._other(other)
        return _promoted(self, other, "__add__") if o is NotImplemented else self.add(o)

    __radd__ = __add__

    def __mul__(self, other):
        if isinstance(other, numbers.Real):
            return self.scaled(other)
        o = self._other(other)
        return _promoted(self, other, "__mul__") if o is NotImplemented else self.mul(o)

    __rmul__ = __mul__

    def __neg__(self):
        return self.scaled(-1)

    def __pos__(self):
        return self

    def __sub__(self, other):
        o = self._other(other)
        return _promoted(self, other, "__sub__") if o is NotImplemented else self.add(-o)

    def __rsub__(self, other):
        return (-self) + other

    def __truediv__(self, other):
        if isinstance(other, numbers.Real):
            return self.divided(other)
        o = self._other(other)
        return _promoted(self, other, "__truediv__") if o is NotImplemented else self.mul(o.inv())

    def __rtruediv__(self, other):
        return self.inv() * other

    def __pow__(self, power):
        if isinstance(power, numbers.Real) and float(power).is_integer():
            return _whole_power(self, int(power))
        if isinstance(power, numbers.Real) and float(2 * power).is_integer():
            return _whole_power(self.sqrt(), int(2 * power))
        return (self.log() * power).exp()

    def __rpow__(self, base):
        return (self * arb(float(base)).log()).exp()

    def sqrt(self):
        return self.apply("sqrt")

    def exp(self):
        return self.apply("exp")

    def log(self):
        return self.apply("log")

    def sin(self):
        return self.apply("sin")

    def cos(self):
        return self.apply("cos")

    def tan(self):
        return self.sin() / self.cos()

    def sinh(self):
        return (self.exp() - (-self).exp()) * 0.5

    def cosh(self):
        return (self.exp() + (-self).exp()) * 0.5

    def tanh(self):
        return 1.0 - 2.0 / ((2.0 * self).exp() + 1.0)

    def arctan(self):
        return self.apply("atan")

    def arcsin(self):
        return self.apply("asin")

    def arccos(self):
        return self.apply("acos")

    def conjugate(self):
        return self

    @property
    def real(self):
        return self

    @property
    def imag(self):
        return 0.0

    def _compare(self, other, low):
        from nsbench.reference.namespace import decide
        return decide(self - other, low)

    def __gt__(self, other):
        return self._compare(other, False)

    def __ge__(self, other):
        return self._compare(other, True)

    def __lt__(self, other):
        return not self._compare(other, True)

    def __le__(self, other):
        return not self._compare(other, False)

    def __abs__(self):
        return self if self._compare(0.0, True) else -self

    def __float__(self):
        raise TypeError("a number of a certificate cannot become a float: the drift leaves the array namespace")

    __bool__ = __int__ = __index__ = __float__


def _promoted(self, other, name):
    """The operation with self lifted to the level of `other`; NotImplemented for arrays, which know what to do."""
    if isinstance(other, Number):
        return getattr(other.lift(self), name)(other)
    if isinstance(other, complex):
        return getattr(Complex(self, 0.0), name)(Complex(other.real, other.imag))
    return NotImplemented


def _whole_power(x, k):
    if k < 0:
        return _whole_power(x, -k).inv()
    if k == 0:
        return x.scaled(0) + 1.0
    half = _whole_power(x, k // 2)
    return half * half * x if k % 2 and k > 1 else x if k == 1 else half * half


class Jet(Number):
    """A power series; s: arb_series."""
    __slots__ = ("s",)
    level = 0

    def __init__(self, s):
        self.s = s

    @classmethod
    def of(cls, coefficients, length: int) -> Jet:
        return cls(arb_series(coefficients, length))

    def lift(self, value):
        return Jet(arb_series([exact(value)]))

    def add(self, o):
        return Jet(self.s + o.s)

    def mul(self, o):
        return Jet(self.s * o.s)

    def scaled(self, c):
        return Jet(self.s * exact(c))

    def divided(self, c):
        return Jet(self.s / exact(c))

    def inv(self):
        return Jet(1 / self.s)

    def apply(self, name):
        return Jet(getattr(self.s, name)())

    @property
    def leading(self) -> Jet:
        return self

    def at(self, k: int) -> arb:
        return self.s[k]

    @property
    def length(self) -> int:
        return self.s.prec

    def derivative(self) -> Jet:
        return Jet(self.s.derivative())

    def integral(self) -> Jet:
        return Jet(self.s.integral())


SLOPES = {          # derivative of f at v, given f(v)
    "sqrt": lambda v, f: 0.5 / f, "exp": lambda v, f: f, "log": lambda v, f: v.inv(), "sin": lambda v, f: v.cos(),
    "cos": lambda v, f: -v.sin(), "atan": lambda v, f: (v * v + 1.0).inv(), "asin": lambda v, f: 1.0 / (1.0 - v * v).sqrt(),
    "acos": lambda v, f: -1.0 / (1.0 - v * v).sqrt(),
}


class Dual(Number):
    """v + sum_j d[j] eps_j, products of eps vanish; level tells nested ones apart (1, 2)."""
    __slots__ = ("d", "level", "v")

    def __init__(self, v, d, level=1):
        self.v, self.d, self.level = v, d, level

    def lift(self, value):
        return Dual(value if isinstance(value, Number) else Jet.lift(None, value), {}, self.level)

    def add(self, o):
        d = dict(self.d)
        for j, b in o.d.items():
            d[j] = d[j] + b if j in d else b
        return Dual(self.v + o.v, d, self.level)

    def mul(self, o):
        d = {j: a * o.v for j, a in self.d.items()}
        for j, b in o.d.items():
            term = self.v * b
            d[j] = d[j] + term if j in d else term
        return Dual(self.v * o.v, d, self.level)

    def scaled(self, c):
        return Dual(self.v * c, {j: a * c for j, a in self.d.items()}, self.level)

    def divided(self, c):
        return Dual(self.v / c, {j: a / c for j, a in self.d.items()}, self.level)

    def inv(self):
        w = self.v.inv()
        slope = -(w * w)
        return Dual(w, {j: a * slope for j, a in self.d.items()}, self.level)

    def apply(self, name):
        f = self.v.apply(name)
        slope = SLOPES[name](self.v, f) if self.d else None
        return Dual(f, {j: a * slope for j, a in self.d.items()}, self.level)

    @property
    def leading(self) -> Jet:
        return self.v.leading


class Complex(Number):
    """re + i im; both real numbers of any kind."""
    __slots__ = ("im", "re")
    level = 9

    def __init__(self, re, im):
        self.re, self.im = re, im

    def lift(self, value):
        return Complex(value, 0.0)

    def add(self, o):
        return Complex(self.re + o.re, self.im + o.im)

    def mul(self, o):
        return Complex(self.re * o.re - self.im * o.im, self.re * o.im + self.im * o.re)

    def scaled(self, c):
        return Complex(self.re * c, self.im * c)

    def divided(self, c):
        return Complex(self.re / c, self.im / c)

    def inv(self):
        size = self.re * self.re + self.im * self.im
        return Complex(self.re / size, -1.0 * self.im / size)

    def apply(self, name):
        if name != "exp":
            raise NotImplementedError(f"certificates know no complex {name}")
        from nsbench.reference.namespace import elementary
        size, c, s = elementary("exp", self.re), elementary("cos", self.im), elementary("sin", self.im)
        return Complex(size * c, size * s)

    def conjugate(self):
        return Complex(self.re, -1.0 * self.im)

    def __abs__(self):
        from nsbench.reference.namespace import elementary
        return elementary("sqrt", self.re * self.re + self.im * self.im)

    @property
    def real(self):
        return self.re

    @property
    def imag(self):
        return self.im

    def _compare(self, other, low):
        raise TypeError("complex numbers have no order")


class JetArray(np.ndarray):
    """An object array of numbers with real and imaginary parts taken entry by entry."""

    @property
    def real(self):
        return _each(self, lambda v: v.real)

    @property
    def imag(self):
        return _each(self, lambda v: v.imag)

    def conj(self):
        return _each(self, lambda v: v.conjugate())

    conjugate = conj


def _each(a, f):
    out = np.empty(np.shape(a), object)
    flat = out.reshape(-1)
    for k, v in enumerate(np.asarray(a, object).reshape(-1)):
        flat[k] = f(v)
    return out.view(JetArray)


def array(values) -> JetArray:
    """Numbers (or nested lists, arrays of them) as a JetArray."""
    return np.array(values, dtype=object).view(JetArray)
