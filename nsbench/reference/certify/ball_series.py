"""Ball series: truncated power series in time with ball coefficients, to evaluate a drift in.

Jet is a truncated series a_0 + a_1 s + ... + O(s^L) whose coefficients are balls (python-flint's
arb_series): every operation rounds outwards, so what is true of a ball is true of every number in
it. nsbench.reference.certify.dual_numbers adds partial derivatives and complex numbers; all three
nest: a Dual of Jets has Jets as value and derivatives.

Source: Johansson, "Arb: efficient arbitrary-precision midpoint-radius interval arithmetic", IEEE
Trans. Comput. 66 (2017); Griewank and Walther, "Evaluating Derivatives" (2008), chapters 3 and 13.
"""

from __future__ import annotations

import numbers
from collections.abc import Sequence

from flint import arb, arb_series

COMPLEX = 9  # level of complex numbers, above all nested derivatives
ROUNDING = 1e-25  # a ball this close to zero counts as zero when the side of a kink must be told


class NotDecided(ArithmeticError):
    """Report a comparison of balls that overlap: the answer differs within the ball."""


def exact(value: float | arb) -> arb:
    """Convert a float, an integer or an arb to an arb without rounding."""
    return value if isinstance(value, arb) else arb(float(value))


class Number:
    """Provide what all kinds of numbers share: operators with arrays and plain numbers on either
    side.

    A kind gives level (numbers of a lower level are constants to it), lift(constant), add, mul,
    neg, inv, the elementary functions through `apply`, and `leading` (the number whose sign decides
    a comparison).
    """

    __slots__ = ()

    def _other(self, other):
        """Convert `other` to a number of this kind; NotImplemented for arrays and numbers of a
        higher level.
        """
        if isinstance(other, Number):
            if other.level > self.level:
                return NotImplemented
            return other if other.level == self.level else self.lift(other)
        if isinstance(other, complex) and not isinstance(other, numbers.Real):
            return NotImplemented if self.level < COMPLEX else self.lift(other)
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

    def sqrt(self) -> Number:
        return self.apply("sqrt")

    def exp(self) -> Number:
        return self.apply("exp")

    def log(self) -> Number:
        return self.apply("log")

    def sin(self) -> Number:
        return self.apply("sin")

    def cos(self) -> Number:
        return self.apply("cos")

    def tan(self) -> Number:
        return self.sin() / self.cos()

    def sinh(self) -> Number:
        return (self.exp() - (-self).exp()) * 0.5

    def cosh(self) -> Number:
        return (self.exp() + (-self).exp()) * 0.5

    def tanh(self) -> Number:
        return 1.0 - 2.0 / ((2.0 * self).exp() + 1.0)

    def arctan(self) -> Number:
        return self.apply("atan")

    def arcsin(self) -> Number:
        return self.apply("asin")

    def arccos(self) -> Number:
        return self.apply("acos")

    def conjugate(self) -> Number:
        return self

    @property
    def real(self) -> Number:
        return self

    @property
    def imag(self) -> float:
        return 0.0

    def _compare(self, other, low):
        from nsbench.reference.certify.array_namespace import decide

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
        raise TypeError(
            "a number of a certificate cannot become a float: the drift leaves the array namespace"
        )

    __bool__ = __int__ = __index__ = __float__


def _promoted(self, other, name):
    """Apply the operation with self lifted to the level of `other`; NotImplemented for arrays."""
    if isinstance(other, Number):
        return getattr(other.lift(self), name)(other)
    if isinstance(other, complex):
        from nsbench.reference.certify.dual_numbers import Complex

        return getattr(Complex(self, 0.0), name)(Complex(other.real, other.imag))
    return NotImplemented


def _whole_power(x, k):
    """Raise a number to an integer power by repeated squaring."""
    if k < 0:
        return _whole_power(x, -k).inv()
    if k == 0:
        return x.scaled(0) + 1.0
    half = _whole_power(x, k // 2)
    return half * half * x if k % 2 and k > 1 else x if k == 1 else half * half


class Jet(Number):
    """Represent a truncated power series with ball coefficients; s: arb_series.

    made: results of operations so far, in this process: what a proof costs, on any machine.
    """

    __slots__ = ("s",)
    level = 0
    made = 0

    def __init__(self, s: arb_series):
        self.s = s
        Jet.made += 1

    @classmethod
    def of(cls, coefficients: Sequence[arb], length: int) -> Jet:
        return cls(arb_series(coefficients, length))

    def lift(self, value: float | arb) -> Jet:
        return Jet(arb_series([exact(value)]))

    def add(self, o: Jet) -> Jet:
        return Jet(self.s + o.s)

    def mul(self, o: Jet) -> Jet:
        return Jet(self.s * o.s)

    def scaled(self, c: float) -> Jet:
        return Jet(self.s * exact(c))

    def divided(self, c: float) -> Jet:
        return Jet(self.s / exact(c))

    def inv(self) -> Jet:
        return Jet(1 / self.s)

    def apply(self, name: str) -> Jet:
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
