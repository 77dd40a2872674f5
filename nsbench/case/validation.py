"""Validation of a case: evaluate its functions once at the start; check shapes and dtypes."""

from __future__ import annotations

from itertools import product

import numpy as np

from nsbench.compilation.factories import as_numpy
from nsbench.problem import LCS, Affine, Distance, Filippov, Smooth


def check_shapes(case) -> None:
    """Evaluate the functions of a case once at (t[0], x0).

    Raises ValueError or TypeError with the function, what it returned and what is needed: float64
    of the right shape; a drift must not change x in place.
    """
    p = case.problem
    x = case.x0.copy()
    t0 = float(case.t[0])
    for name in ("exact", "exact_impulse"):
        _check_exact(case, name, getattr(case, name))
    if isinstance(p, LCS):
        _check_inputs(case)
        return
    with np.errstate(all="ignore"):
        if isinstance(p, Filippov):
            c = np.asarray(as_numpy(p.switch)(t0, x))
            if c.ndim != 1 or c.dtype != np.float64:
                raise ValueError(
                    f"switch of {case.name} returns {c.dtype} of shape {c.shape}; float64 (d,) is "
                    f"needed"
                )
            found = [
                np.asarray(as_numpy(p.field)(t0, x, np.array(s))) for s in _sign_samples(len(c))
            ]
        else:
            for c in p.constraints:
                if isinstance(c, Distance):
                    c.particles(case.n)
                elif hasattr(c, "shape") and c.shape[1] != case.n:
                    raise ValueError(
                        f"A of {case.name} has {c.shape[1]} columns, the state {case.n} entries"
                    )
                _check_curves(case, c, t0, x)
            found = [np.asarray(as_numpy(p.drift)(t0, x))]
    for f in found:
        if f.shape != x.shape or f.dtype != np.float64:
            raise ValueError(
                f"drift of {case.name} returns {f.dtype} of shape {f.shape}; float64 {x.shape} is "
                f"needed"
            )
    if not np.array_equal(x, case.x0):
        raise ValueError(f"drift of {case.name} changes x in place")


def _check_exact(case, name: str, solution) -> None:
    """Check that a closed form is in double precision.

    Its exceptions, shape and values are reported when it is used.
    """
    if solution is None:
        return
    with np.errstate(all="ignore"):
        try:
            a = np.asarray(solution(case.t))
        except Exception:  # user code: reported where the closed form is needed
            return
    if a.dtype in (np.float32, np.float16, np.complex64):
        raise TypeError(f"{name} of {case.name} returns {a.dtype}; float64 is needed")


def _sign_samples(d: int) -> list[tuple]:
    """List the sign patterns to evaluate: all 2^d up to d = 3, else the two uniform ones."""
    return list(product((1.0, -1.0), repeat=d)) if d <= 3 else [(1.0,) * d, (-1.0,) * d]


def _check_curves(case, c, t0: float, x) -> None:
    """Check what the factories of a constraint family return at the start: float64, right shape."""
    if isinstance(c, Smooth):
        made = {"g": (as_numpy(c.g)(t0, x), None)}
    else:
        made = (
            {"b": (as_numpy(c.b)(t0), (c.shape[0],))} if isinstance(c, Affine) and c.moving else {}
        )
        if isinstance(c, Distance) and c.moving:
            made["anchors"] = (as_numpy(c.anchors)(t0), None)
    for name, (value, shape) in made.items():
        a = np.asarray(value)
        if a.dtype in (np.float32, np.float16) or a.dtype.kind not in "fiu":
            raise TypeError(f"{name} of {case.name} returns {a.dtype}; float64 is needed")
        if (
            (shape is not None and a.shape != shape)
            or (name == "g" and a.ndim != 1)
            or (name == "anchors" and (a.ndim != 2 or a.shape[1] != c.dim))
        ):
            wanted = shape or ("(m,)" if name == "g" else f"(a, {c.dim})")
            raise ValueError(
                f"{name} of {case.name} returns the shape {a.shape}; {wanted} is needed"
            )


def _check_inputs(case) -> None:
    """Check the inputs u (n,) and q (m,) of a linear complementarity system at the start."""
    p = case.problem
    t0 = float(case.t[0])
    if p.A.shape[0] != case.n:
        raise ValueError(f"A of {case.name} has {p.A.shape[0]} rows, the state {case.n} entries")
    for name, factory, size in (("u", p.u, case.n), ("q", p.q, p.B.shape[1])):
        if factory is None:
            continue
        with np.errstate(all="ignore"):
            value = np.asarray(as_numpy(factory)(t0))
        if value.shape != (size,) or value.dtype != np.float64:
            raise ValueError(
                f"{name} of {case.name} returns {value.dtype} of shape {value.shape}; float64 "
                f"({size},) is needed"
            )
