"""Checks of the functions of a case: finite, repeatable, and the same in numpy, numba and JAX.

Each function is evaluated at the start and at random feasible points. Interval jets and tracing
arrays are used by the event-driven method, which says by itself if it could be compiled and proven.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from nsbench import input_errors
from nsbench.case import Case
from nsbench.compilation import factories
from nsbench.compilation.user_forms.jax_errors import NotTraceable
from nsbench.dynamics.scaling.estimate import case_scale
from nsbench.problem import LCS, Affine, Complementarity, Distance, Filippov, Hybrid, Smooth

RANDOM_POINTS = 8
HALVINGS = 30  # of the distance of a random point from the start, until it is feasible
NAMESPACE_RTOL = 1e-13  # of a value in two namespaces: some roundings
SLOPE_STEP = 1e-6  # relative to the size of a coordinate, of central differences
SLOPE_RTOL = 1e-5  # of a derivative by central differences


@dataclass(frozen=True)
class Function:
    """A function of a case: its name, factory, symbols of its arguments, and its compiled form.

    compile(value) returns a pointer (t, ..., out), None where no kernel calls the function.
    """

    name: str
    factory: Callable
    arguments: str
    compile: Callable | None = None


def functions_of(case: Case) -> Iterator[Function]:
    """Yield the functions of the case that its problem class calls."""
    p = case.problem
    if isinstance(p, Complementarity):
        yield Function("drift", p.drift, "tx", lambda v: factories.rhs_cfunc(p.drift, case.n))
        for c in p.constraints:
            yield from _functions_of_family(c)
    elif isinstance(p, Filippov):
        yield Function("switch", p.switch, "tx")
        yield Function(
            "drift", p.field, "txs", lambda v: factories.signed_rhs_cfunc(p.field, case.n, v)
        )
    elif isinstance(p, Hybrid):
        for mode, drift in p.modes.items():
            yield Function(f"drift of mode {mode!r}", drift, "tx")
        for k, transition in enumerate(p.transitions):
            yield Function(f"guard of transition {k}", transition.guard, "tx")
            if transition.reset is not None:
                yield Function(f"reset of transition {k}", transition.reset, "tx")
    elif isinstance(p, LCS):
        for name in "uq":
            if getattr(p, name) is not None:
                yield _curve(name, getattr(p, name))


def _functions_of_family(c) -> Iterator[Function]:
    if isinstance(c, Affine) and c.moving:
        yield _curve("b", c.b)
    elif isinstance(c, Distance) and c.moving:
        yield _curve("anchors", c.anchors)
    elif isinstance(c, Smooth):
        for name in ("g", "gradient", "rate"):
            if getattr(c, name) is not None:
                yield Function(name, getattr(c, name), "tx")


def _curve(name: str, factory: Callable) -> Function:
    return Function(name, factory, "t", lambda size: factories.curve_cfunc(factory, size))


def check_functions(case: Case) -> list[str]:
    """Check every function of the case at the start and at random points; returns sentences."""
    violations = []
    with np.errstate(all="ignore"):
        points = list(_points(case))
        for function in functions_of(case):
            violations += _check_values(case, function, points) or [
                *_check_numba(case, function, points),
                # no method runs hybrid systems in JAX
                *([] if isinstance(case.problem, Hybrid) else _check_jax(case, function, points)),
            ]
        if not violations:
            violations += _check_slopes(case, points)
    return violations


def _points(case: Case) -> Iterator[tuple[float, np.ndarray]]:
    """Yield the start, and random points (t, x) near it that satisfy the constraints."""
    yield float(case.t[0]), case.x0.copy()
    rng = np.random.default_rng(0)
    sizes = case_scale(case).state
    for _ in range(RANDOM_POINTS):
        t = float(rng.uniform(case.t[0], case.t[-1]))
        direction = sizes * rng.uniform(-1.0, 1.0, case.n)
        for k in range(HALVINGS):
            x = case.x0 + 0.5**k * direction
            if _is_feasible(case, t, x):
                yield t, x
                break


def _is_feasible(case: Case, t: float, x: np.ndarray) -> bool:
    if not isinstance(case.problem, Complementarity) or not case.problem.constraints:
        return True
    from nsbench.dynamics.contacts.constraint_set import ConstraintSet

    try:
        return ConstraintSet(case.problem, case.n).max_violation(t, x) <= 0.0
    except Exception:  # a gap that cannot be evaluated here is reported where it is
        return True


def _call(case: Case, function: Function, point: tuple) -> tuple:
    """Return the arguments of the function at a point (t, x)."""
    t, x = point
    if function.arguments == "t":
        return (t,)
    if function.arguments == "tx":
        return t, x.copy()
    d = len(np.asarray(factories.as_numpy(case.problem.switch)(t, x.copy())))
    return t, x.copy(), np.ones(d)


def _place(point: tuple) -> str:
    t, x = point
    shown = np.array2string(x[:4], precision=6, separator=", ")
    return f"t = {t:.6g}, x = {shown}{' ...' if len(x) > 4 else ''}"


def _check_values(case: Case, function: Function, points: list) -> list[str]:
    """Check that numpy's values are finite, of one shape, and the same when evaluated again."""
    shape = None
    for k, point in enumerate(points):
        where = f"at the start, {_place(point)}" if k == 0 else f"at the feasible {_place(point)}"
        arguments = _call(case, function, point)
        try:
            value, again = (
                np.asarray(factories.as_numpy(function.factory)(*arguments)) for _ in range(2)
            )
        except Exception as e:  # user code: whatever it raises is reported with the point
            described = input_errors.describe(e, case.source)
            return [f"the {function.name} fails {where}: {described}"]
        if not np.all(np.isfinite(value)):
            worst = value[~np.isfinite(value)].flat[0]
            return [f"the {function.name} is {worst} {where}; it must be finite there"]
        if not np.array_equal(value, again):
            return [
                f"the {function.name} gives two values {where}: it must depend on nothing but its "
                f"arguments (no random numbers, no counters)"
            ]
        if shape not in (None, value.shape):
            return [f"the {function.name} has the shape {value.shape} {where}, {shape} before"]
        shape = value.shape
    return []


def _differs(value: np.ndarray, expected: np.ndarray) -> float:
    """Return the largest difference if it is more than rounding, else 0."""
    size = max(1.0, float(np.abs(expected).max(initial=0.0)))
    difference = float(np.abs(value - expected).max(initial=0.0))
    return 0.0 if difference <= NAMESPACE_RTOL * size else difference


def _check_numba(case: Case, function: Function, points: list) -> list[str]:
    """Compare the compiled function with numpy."""
    import numba

    if function.compile is None:
        return []
    call = numba.njit(lambda f, *a: f(*a))
    for point in points:
        arguments = _call(case, function, point)
        expected = np.asarray(factories.as_numpy(function.factory)(*arguments))
        size = len(arguments[2]) if len(arguments) == 3 else expected.size
        try:
            pointer = function.compile(size)
        except factories.CompileError as e:
            return [
                f"numba cannot compile the {function.name}, runs will be slow: {e}; use "
                f"functions of xp, numbers and arrays only"
            ]
        value = np.empty(expected.size)
        call(pointer, *arguments, value)
        if off := _differs(value, expected.ravel()):
            return [f"the {function.name} compiled by numba differs from numpy by {off:.3g}"]
    return []


def _check_jax(case: Case, function: Function, points: list) -> list[str]:
    """Compare the function in JAX with numpy, and trace it as compiled methods do."""
    import jax

    try:
        made = factories.as_jax(function.factory)
        for point in points:
            arguments = _call(case, function, point)
            expected = np.asarray(factories.as_numpy(function.factory)(*arguments))
            if off := _differs(np.asarray(made(*arguments)), expected):
                return [f"the {function.name} in JAX differs from numpy by {off:.3g}"]
        jax.make_jaxpr(made)(*arguments)
    except NotTraceable as e:
        return [f"JAX cannot run the {function.name}, so penalty cannot: {e}"]
    except Exception as e:  # of any other kind, or of the factory
        place = input_errors.place_of(e, case.source)
        text = next(iter(str(e).splitlines()), "")[:200]
        return [
            f"JAX cannot run the {function.name}{place}, so penalty cannot: {type(e).__name__}: "
            f"{text}"
        ]
    return []


def _check_slopes(case: Case, points: list) -> list[str]:
    """Compare a given gradient and rate of a Smooth family with central differences of g."""
    violations = []
    for c in getattr(case.problem, "constraints", ()):
        if not isinstance(c, Smooth):
            continue
        g = factories.as_numpy(c.g)
        sizes = np.broadcast_to(case_scale(case).state, case.n)
        for t, x in points:
            if c.gradient is not None:
                rows = [
                    _slope(lambda s, k=k: g(t, x + s * np.eye(case.n)[k]), sizes[k] * SLOPE_STEP)
                    for k in range(case.n)
                ]
                given = np.asarray(factories.as_numpy(c.gradient)(t, x.copy()))
                violations += _compare_slopes("gradient", given, np.array(rows).T)
            if c.rate is not None:
                step = SLOPE_STEP * float(case.t[-1] - case.t[0])
                rate = _slope(lambda s: g(t + s, x), step)  # noqa: B023
                given = np.asarray(factories.as_numpy(c.rate)(t, x.copy()))
                violations += _compare_slopes("rate", given, rate)
            if violations:
                return violations
    return violations


def _slope(f: Callable, step: float) -> np.ndarray:
    return (np.asarray(f(step)) - np.asarray(f(-step))) / (2.0 * step)


def _compare_slopes(name: str, given: np.ndarray, expected: np.ndarray) -> list[str]:
    """Compare a derivative that a case gives with the one by differences."""
    if given.shape != expected.shape:
        return [f"the {name} has the shape {given.shape}; {expected.shape} is needed"]
    off = float(np.abs(given - expected).max(initial=0.0))
    if off <= SLOPE_RTOL * max(1.0, float(np.abs(expected).max(initial=0.0))):
        return []
    return [f"the {name} differs from the differences of g by {off:.3g}; leave it out, or mend it"]
