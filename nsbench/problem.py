"""The three problem classes and the families of constraints, as frozen data.

Complementarity (gradient) system of first order::

    x' = f(t, x) + sum_k lambda_k grad g_k(t, x),    0 <= g_k  _|_  lambda_k >= 0

Filippov system: ``x'`` in the convex hull of the fields that meet at x. Linear
complementarity system: ``x' = A x + B lambda + u(t)``, ``w = C x + D lambda + q(t)``,
``0 <= w _|_ lambda >= 0``.

Physics is written once: a *factory* takes an array namespace and returns the function,
``drift(xp) -> f(t, x)``. Data is checked here, at the border; nothing below checks it again.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import product
from typing import Any

import numpy as np

from nsbench.input_errors import check_factory, named_fields

Factory = Callable[[Any], Callable]


def _floats(name: str, value, ndim: int | None = None) -> np.ndarray:
    """Return a read-only float64 copy of `value`; raise TypeError or ValueError for float32,
    complex and non-finite data.
    """
    a = np.asarray(value)
    if a.dtype == np.float32 or a.dtype == np.float16:
        raise TypeError(
            f"{name} is {a.dtype}; arrays must be float64 (rounding at 1e-7 would be read as "
            f"method error)"
        )
    if a.dtype.kind not in "fiub":
        raise TypeError(f"{name} has dtype {a.dtype}; real numbers are needed")
    a = np.array(a, dtype=np.float64)
    if ndim is not None and a.ndim != ndim:
        raise ValueError(f"{name} has shape {a.shape}; {ndim} dimension(s) are needed")
    if not np.all(np.isfinite(a)):
        raise ValueError(f"{name} contains {a[~np.isfinite(a)].flat[0]}; finite numbers are needed")
    a.flags.writeable = False
    return a


@named_fields
@dataclass(frozen=True, eq=False)
class Affine:
    """g = A x + b, m constraints.

    A: (m, n) array or scipy sparse matrix. b: (m,) array, or a factory ``b(xp) -> (t) -> (m,)``
    for moving walls.
    """

    A: Any = field(repr=False)
    b: Any = field(repr=False)
    indptr: np.ndarray = field(init=False, repr=False)
    indices: np.ndarray = field(init=False, repr=False)
    data: np.ndarray = field(init=False, repr=False)
    shape: tuple[int, int] = field(init=False)

    def __post_init__(self):
        if hasattr(self.A, "tocsr"):
            csr = self.A.tocsr()
            ptr = csr.indptr
            cols = csr.indices
            vals = _floats("A", csr.data, 1).copy()
            shape = csr.shape
        else:
            A = _floats("A", self.A, 2)
            rows, cols = np.nonzero(A)
            ptr = np.searchsorted(rows, np.arange(A.shape[0] + 1))
            vals = A[rows, cols]
            shape = A.shape
        zero = np.flatnonzero(np.diff(ptr) == 0)
        if zero.size:
            raise ValueError(
                f"row {zero[0]} of A is zero: a constraint without gradient cannot be projected on"
            )
        if callable(self.b):
            check_factory("b", self.b, "b(t)")
        else:
            b = _floats("b", self.b, 1)
            if b.shape != (shape[0],):
                raise ValueError(f"b has shape {b.shape}, A has {shape[0]} rows")
            object.__setattr__(self, "b", b)
        # contiguous: kernels are compiled for one kind of array, and nonzero gives strided ones
        for name, value in (
            ("indptr", np.ascontiguousarray(ptr, np.int64)),
            ("indices", np.ascontiguousarray(cols, np.int64)),
            ("data", np.ascontiguousarray(vals, np.float64)),
            ("shape", tuple(map(int, shape))),
        ):
            object.__setattr__(self, name, value)

    @property
    def moving(self) -> bool:
        return callable(self.b)


@named_fields
@dataclass(frozen=True, eq=False)
class Distance:
    """g = sign (|x_i - x_j| - d) between particles of dimension `dim`.

    pairs None: hard particles, all N(N-1)/2 pairs without ever listing them (sign +1; d a number,
    or `radii` (N,) for d_ij = r_i + r_j). pairs (m, 2): fixed pairs, sign -1 for links of maximal
    length, d a number or (m,). anchors (a, dim), or a factory ``anchors(xp) -> (t) -> (a, dim)``:
    pairs are then (particle, anchor); without pairs every particle meets every anchor.
    The particles are ``x[start : start + count * dim].reshape(count, dim)``; count None means up to
    the end.
    """

    d: Any = None
    sign: int = +1
    pairs: Any = None
    anchors: Any = None
    dim: int = 2
    start: int = 0
    count: int | None = None
    radii: Any = None

    def __post_init__(self):
        if self.sign not in (+1, -1):
            raise ValueError(
                f"sign is {self.sign!r}; +1 (at least d apart) or -1 (at most d apart)"
            )
        if self.dim not in (1, 2, 3):
            raise ValueError(f"dim is {self.dim!r}; 1, 2 or 3")
        if (self.d is None) == (self.radii is None):
            raise ValueError("give either d or radii")
        name = "d" if self.radii is None else "radii"
        d = _floats(name, getattr(self, name))
        if np.any(d <= 0):
            raise ValueError(f"{name} contains {d[d <= 0].flat[0]}; distances are positive")
        object.__setattr__(self, name, d)
        if self.pairs is None and self.anchors is None:
            if self.sign != 1:
                raise ValueError("links (sign=-1) need a list of pairs")
            if name == "d" and d.ndim:
                raise ValueError("d of all pairs is one number; use radii for different sizes")
        elif name == "radii":
            raise ValueError("radii are for all pairs; fixed pairs take d")
        if self.anchors is not None and not callable(self.anchors):
            a = _floats("anchors", self.anchors, 2)
            if a.shape[1] != self.dim:
                raise ValueError(f"anchors have shape {a.shape}; dim is {self.dim}")
            object.__setattr__(self, "anchors", a)
        if self.pairs is not None:
            self._check_pairs()

    def _check_pairs(self):
        p = np.array(self.pairs, dtype=np.int64).reshape(-1, 2)
        if p.size and p.min() < 0:
            raise ValueError(f"pairs contain the index {p.min()}")
        if self.anchors is None and np.any(p[:, 0] == p[:, 1]):
            raise ValueError(f"pair {p[p[:, 0] == p[:, 1]][0].tolist()} joins a particle to itself")
        seen = p if self.anchors is not None else np.sort(p, axis=1)
        if len(np.unique(seen, axis=0)) < len(p):
            raise ValueError("a pair is listed twice; put the second one in a family of its own")
        if self.d.ndim and self.d.shape != (len(p),):
            raise ValueError(f"d has shape {self.d.shape} for {len(p)} pairs")
        object.__setattr__(self, "pairs", p)

    @property
    def moving(self) -> bool:
        return callable(self.anchors)

    @property
    def all_pairs(self) -> bool:
        return self.pairs is None and self.anchors is None

    def particles(self, n: int) -> int:
        """How many particles the state of size n holds for this family; ValueError if it does not
        divide."""
        count = (n - self.start) // self.dim if self.count is None else self.count
        if self.start + count * self.dim > n or (
            self.count is None and (n - self.start) % self.dim
        ):
            raise ValueError(
                f"the state has {n} entries; particles of dimension {self.dim} from {self.start} "
                f"do not fit"
            )
        if self.radii is not None and self.radii.ndim and len(self.radii) != count:
            raise ValueError(f"{len(self.radii)} radii for {count} particles")
        return count


@named_fields
@dataclass(frozen=True, eq=False)
class Smooth:
    """g(t, x) >= 0 for anything else; m constraints.

    g: factory ``g(xp) -> (t, x) -> (m,)``. gradient: factory ``-> (t, x) -> (m, n)``; rate: factory
    ``-> (t, x) -> (m,)`` for the partial derivative in t. Both come from JAX unless given.
    """

    g: Factory
    gradient: Factory | None = None
    rate: Factory | None = None

    def __post_init__(self):
        check_factory("g", self.g, "g(t, x)")

    moving = True


@named_fields
@dataclass(frozen=True, eq=False)
class Complementarity:
    """x' = f + sum lambda_k grad g_k, 0 <= g_k _|_ lambda_k >= 0; no constraints: a plain smooth
    ODE."""

    drift: Factory
    constraints: tuple = ()

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
            return inner(t, x)

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
        B = _floats("B", B, 2)

        def field(xp: Any) -> Callable:
            f = drift(xp)
            b = B + 0.0
            if xp.__name__ != "numpy":
                b = xp.asarray(b)

            def g(t: float, x: np.ndarray, s: np.ndarray) -> np.ndarray:
                return f(t, x) + b @ s

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

    def __post_init__(self):
        for name in "ABCD":
            object.__setattr__(self, name, _floats(name, getattr(self, name), 2))
        (n, n2), (nb, m), (mc, nc) = self.A.shape, self.B.shape, self.C.shape
        if not (n == n2 == nb == nc and m == mc and self.D.shape == (m, m)):
            raise ValueError(
                f"shapes do not fit: A {self.A.shape} B {self.B.shape} C {self.C.shape} D "
                f"{self.D.shape}"
            )
        for name in "uq":
            if getattr(self, name) is not None:
                check_factory(name, getattr(self, name), f"{name}(t)")
