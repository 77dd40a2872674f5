"""Gradient systems, Filippov systems and linear complementarity systems, as frozen data."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any, ClassVar

import numpy as np

from nsbench.input_errors import check_factory, named_fields
from nsbench.problem.constraints import Affine, Distance, Factory, Smooth, float_array


@named_fields
@dataclass(frozen=True, eq=False)
class Complementarity:
    """x' = f + sum lambda_k grad g_k, 0 <= g_k _|_ lambda_k >= 0; no constraints: a plain smooth
    ODE."""

    drift: Factory
    constraints: tuple = ()
    kind: ClassVar[str] = "complementarity system"

    def __post_init__(self):
        check_factory("drift", self.drift, "f(t, x)")
        families = self.constraints
        if isinstance(families, (Affine, Distance, Smooth)):
            raise TypeError(
                f"constraints is one {type(families).__name__}; a tuple of families is needed: "
                f"constraints=({type(families).__name__}(...),), with the comma"
            )
        for c in families:
            if not isinstance(c, (Affine, Distance, Smooth)):
                raise TypeError(f"constraint {c!r} is none of Affine, Distance, Smooth")
        object.__setattr__(self, "constraints", tuple(self.constraints))


def _blend(plus, minus, axis):
    """Factory of  w f_plus + (1 - w) f_minus,  w = (1 + s_axis) / 2; at w = 0 or 1 one side alone
    counts."""

    def make(xp: Any) -> Callable:
        fp = plus(xp)
        fm = minus(xp)
        if xp.__name__ == "numpy":

            def f(t: float, x: np.ndarray, s: np.ndarray) -> np.ndarray:
                w = 0.5 * (1.0 + s[axis])
                if w >= 1.0:
                    return fp(t, x, s)
                if w <= 0.0:
                    return fm(t, x, s)
                return w * fp(t, x, s) + (1.0 - w) * fm(t, x, s)
        else:

            def f(t: float, x: np.ndarray, s: np.ndarray) -> np.ndarray:
                w = 0.5 * (1.0 + s[axis])
                a = fp(t, x, s)
                b = fm(t, x, s)
                return xp.where(w >= 1.0, a, xp.where(w <= 0.0, b, w * a + (1.0 - w) * b))

        return f

    return make


def _leaf(drift):
    def make(xp: Any) -> Callable:
        inner = drift(xp)

        def f(t: float, x: np.ndarray, s: np.ndarray) -> np.ndarray:
            return xp.asarray(inner(t, x))  # of a list or tuple

        return f

    return make


def _modes_by_signs(given) -> dict[tuple[int, ...], Factory]:
    """Return the drifts of all modes by sign tuple; of one surface the signs may be bare: {+1: f}.

    Raises TypeError or ValueError with the keys that are needed.
    """
    if not isinstance(given, Mapping) or not given:
        raise TypeError(
            f"modes is {type(given).__name__} {given!r:.60}; a dict from signs to drifts is "
            "needed, such as {+1: f_plus, -1: f_minus} for one surface"
        )
    modes = {}
    for key, drift in given.items():
        signs = key if isinstance(key, tuple) else (key,)
        if not all(isinstance(s, (int, float, np.number)) and s in (1, -1) for s in signs):
            raise ValueError(
                f"modes has the key {key!r}; a key is +1 or -1, or a tuple of these, one sign for "
                "each surface: (+1, -1)"
            )
        modes[tuple(int(s) for s in signs)] = drift
    d = len(next(iter(modes)))
    want = set(product((1, -1), repeat=d))
    if set(modes) != want:
        raise ValueError(
            f"modes has the sign tuples {sorted(modes)}; {d} surface{'s' * (d > 1)} need "
            f"{sorted(want)}"
        )
    for signs, drift in modes.items():
        check_factory(f"modes[{signs}]", drift, "f(t, x)")
    return modes


@named_fields
@dataclass(frozen=True, eq=False)
class Filippov:
    """x' in co{f_i(x)} over the regions that meet at x; d surfaces c(t, x) = 0.

    modes: maps sign tuples to drifts, 2^d of them; of one surface also {+1: f, -1: g}. switch:
    factory ``-> (t, x) -> (d,)``.
    Everything is reduced to one `field(xp) -> (t, x, s)` with signs s in [-1, 1]^d: between the
    modes it is multilinear in the weights theta = (1 + s) / 2 (Alexander & Seidman 1998), which for
    one surface is Filippov's convexification. theta_i in [0, 1] is the weight of the positive side.
    Where d > 1 surfaces meet this is a convention: of all convex combinations of the 2^d fields
    that stay on them it takes one of product weights. They all move alike if the field is affine in
    the signs; else a case that wants all of Filippov's solutions says so with ``unique=False`` and
    gives their `distance`.
    """

    modes: Mapping | None
    switch: Factory
    field: Factory | None = None
    d: int | None = None
    kind: ClassVar[str] = "Filippov system"

    def __post_init__(self):
        check_factory("switch", self.switch, "c(t, x)")
        if self.field is not None:
            check_factory("field", self.field, "f(t, x, s)")
            return
        modes = _modes_by_signs(self.modes)
        d = len(next(iter(modes)))

        def build(prefix: tuple[int, ...]) -> Factory:
            if len(prefix) == d:
                return _leaf(modes[prefix])
            return _blend(build((*prefix, 1)), build((*prefix, -1)), len(prefix))

        object.__setattr__(self, "modes", modes)
        object.__setattr__(self, "field", build(()))
        object.__setattr__(self, "d", d)

    @classmethod
    def signs(cls, field: Factory, switch: Factory) -> Filippov:
        """One field with the signs as an argument: ``field(xp) -> (t, x, s)``, s in [-1, 1]^d."""
        return cls(None, switch, field)

    @classmethod
    def relay(cls, drift: Factory, B: np.ndarray, switch: Factory) -> Filippov:
        """x' = f + B s, s_i in Sgn(c_i); B is (n, d)."""
        B = float_array("B", B, 2)

        def field(xp: Any) -> Callable:
            f = drift(xp)
            b = B + 0.0
            if xp.__name__ != "numpy":
                b = xp.asarray(b)

            def g(t: float, x: np.ndarray, s: np.ndarray) -> np.ndarray:
                return xp.asarray(f(t, x)) + b @ s

            return g

        return cls(None, switch, field, B.shape[1])


@named_fields
@dataclass(frozen=True, eq=False)
class LCS:
    """x' = A x + B lambda + u(t), w = C x + D lambda + q(t), 0 <= w _|_ lambda >= 0; u, q are
    factories."""

    A: Any
    B: Any
    C: Any
    D: Any
    u: Factory | None = None
    q: Factory | None = None
    kind: ClassVar[str] = "linear complementarity system"

    def __post_init__(self):
        for name in "ABCD":
            object.__setattr__(self, name, float_array(name, getattr(self, name), 2))
        (n, n2), (nb, m), (mc, nc) = self.A.shape, self.B.shape, self.C.shape
        if not (n == n2 == nb == nc and m == mc and self.D.shape == (m, m)):
            raise ValueError(
                f"shapes do not fit: A {self.A.shape} B {self.B.shape} C {self.C.shape} D "
                f"{self.D.shape}"
            )
        for name in "uq":
            if getattr(self, name) is not None:
                check_factory(name, getattr(self, name), f"{name}(t)")
