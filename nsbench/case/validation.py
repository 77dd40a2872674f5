"""Validation of a case: evaluate its functions once at the start; check shapes and dtypes."""

from __future__ import annotations

from itertools import product

import numpy as np

from nsbench.compilation.factories import as_numpy
from nsbench.input_errors import remedy
from nsbench.problem import LCS, Affine, Distance, Filippov, Hybrid, Smooth


def check_shapes(case) -> None:
    """Evaluate the functions of a case once at (t[0], x0).

    Raises ValueError or TypeError with the function, what it raised or returned, and what is
    needed: float64 of the right shape; a drift must not change x in place.
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
            _check_modes(case, t0, x)
        elif isinstance(p, Hybrid):
            _check_transitions(case, t0, x)
        else:
            for c in p.constraints:
                _check_family(case, c, t0, x)
            _check_drift(case, "drift", evaluate(case, "drift", p.drift, t0, x))
    if not np.array_equal(x, case.x0):
        raise ValueError(f"drift of {case.name} changes x in place")


def evaluate(case, name: str, factory, *arguments) -> np.ndarray:
    """Evaluate a factory's function in numpy at the start and return its value as an array.

    Raises ValueError with the name, what was raised and the sizes of the arguments; TypeError if
    the factory returns no function, or the function nothing.
    """
    try:
        function = factory(np)
        value = as_numpy(lambda xp: function)(*arguments) if callable(function) else 0.0
        array = np.asarray(value)
    except MemoryError:
        raise
    except Exception as e:  # user code: whatever it raises is reported with the function's name
        entries = " and ".join(
            f"{symbol} has {len(a)}" for symbol, a in zip("xs", arguments[1:], strict=False)
        )
        sizes = f" ({entries} entries)" if entries else ""
        raise ValueError(
            f"{name} of {case.name} fails at the start{sizes}: {type(e).__name__}: {e}{remedy(e)}"
        ) from e
    if not callable(function):
        raise TypeError(
            f"{name} of {case.name} is a factory that returns {type(function).__name__}; it must "
            f"return the function defined in it: is its last line, `return f`, missing?"
        )
    if value is None:
        raise TypeError(
            f"{name} of {case.name} returns None at the start; an array is needed: is the "
            f"`return` of the inner function missing?"
        )
    return array


def _check_drift(case, name: str, value: np.ndarray) -> None:
    """Check that the value (n,) of a drift is float64 and of the shape of the state."""
    if value.shape != case.x0.shape or value.dtype != np.float64:
        raise ValueError(
            f"{name} of {case.name} returns {value.dtype} of shape {value.shape}; float64 "
            f"{case.x0.shape} is needed{_hint(value.shape, case.x0.shape)}"
        )


def _hint(shape, wanted) -> str:
    """Return how a number is made the vector of one entry that is wanted, as the end of a
    sentence; else "".
    """
    return ": write `return [v]` for a number v" if shape == () and wanted == (1,) else ""


def _check_modes(case, t0: float, x: np.ndarray) -> None:
    """Check the switch (d,) and the drift (n,) of each mode of a Filippov system at the start."""
    p = case.problem
    c = evaluate(case, "switch", p.switch, t0, x)
    if c.ndim != 1 or c.dtype != np.float64:
        raise ValueError(
            f"switch of {case.name} returns {c.dtype} of shape {c.shape}; float64 (d,) is needed: "
            f"xp.array([c]) makes an array of a number"
        )
    if p.d is not None and len(c) != p.d:
        raise ValueError(
            f"switch of {case.name} returns {len(c)} values, the modes or B are for {p.d} "
            f"surface{'s' * (p.d > 1)}"
        )
    for s in _sign_samples(len(c)):
        if p.modes is None:
            value = evaluate(case, "field", p.field, t0, x, np.array(s))
        else:
            name = f"modes[{tuple(map(int, s))}]"
            value = evaluate(case, name, p.modes[tuple(map(int, s))], t0, x)
        _check_drift(case, "drift" if p.modes is None else name, value)


def _check_transitions(case, t0: float, x: np.ndarray) -> None:
    """Check drifts and resets (n,) and guards (numbers) of a hybrid system at the start."""
    p = case.problem
    for mode, drift in p.modes.items():
        name = f"modes[{mode!r}]"
        _check_drift(case, name, evaluate(case, name, drift, t0, x))
    for k, transition in enumerate(p.transitions):
        name = f"guard of transition {k}"
        value = evaluate(case, name, transition.guard, t0, x)
        if value.size != 1 or value.dtype != np.float64:
            raise ValueError(
                f"{name} of {case.name} returns {value.dtype} of shape {value.shape}; one float64 "
                "is needed"
            )
        if transition.reset is not None:
            name = f"reset of transition {k}"
            _check_drift(case, name, evaluate(case, name, transition.reset, t0, x))


def _check_family(case, c, t0: float, x: np.ndarray) -> None:
    """Check that a family of constraints fits the state of the case."""
    if isinstance(c, Distance):
        count = c.particles(case.n)
        if c.pairs is not None and len(c.pairs):
            particles = c.pairs if c.anchors is None else c.pairs[:, :1]
            if particles.max() >= count:
                raise ValueError(
                    f"pairs of {case.name} contain the particle {particles.max()}; the state "
                    f"holds {count}, 0 to {count - 1}"
                )
    elif hasattr(c, "shape") and c.shape[1] != case.n:
        raise ValueError(f"A of {case.name} has {c.shape[1]} columns, the state {case.n} entries")
    _check_curves(case, c, t0, x)


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
    made: dict[str, tuple[np.ndarray, tuple[int, ...] | None]] = {}
    if isinstance(c, Smooth):
        made["g"] = (evaluate(case, "g", c.g, t0, x), None)
    else:
        if isinstance(c, Affine) and c.moving:
            made["b"] = (evaluate(case, "b", c.b, t0), (c.shape[0],))
        if isinstance(c, Distance) and c.moving:
            made["anchors"] = (evaluate(case, "anchors", c.anchors, t0), None)
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
                f"{_hint(a.shape, (1,) if name == 'g' else shape)}"
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
            value = evaluate(case, name, factory, t0)
        if value.shape != (size,) or value.dtype != np.float64:
            raise ValueError(
                f"{name} of {case.name} returns {value.dtype} of shape {value.shape}; float64 "
                f"({size},) is needed{_hint(value.shape, (size,))}"
            )
