"""Families of constraints g >= 0: rows of a matrix, distances of particles, smooth functions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from nsbench.input_errors import check_factory, named_fields

Factory = Callable[[Any], Callable]


def float_array(name: str, value, ndim: int | None = None) -> np.ndarray:
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
            vals = float_array("A", csr.data, 1).copy()
            shape = csr.shape
        else:
            A = float_array("A", self.A, 2)
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
            b = float_array("b", self.b, 1)
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
        d = float_array(name, getattr(self, name))
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
            a = float_array("anchors", self.anchors, 2)
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
