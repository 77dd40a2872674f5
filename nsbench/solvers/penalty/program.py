"""Compiled program of a penalised problem, one for all k, starts, times and tolerances."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from nsbench.compilation.function_digest import Unknown, fingerprint
from nsbench.compilation.jax_cache import float64, program
from nsbench.compilation.user_forms.jax_errors import NotTraceable, describe_jax_error
from nsbench.problem import Complementarity, Filippov
from nsbench.trajectory import STATES_BETWEEN


@dataclass(frozen=True)
class Program:
    """run: the executable, as _diffrax.integrator describes; ids and columns of the listed
    constraints among the quadratures; size: number of quadratures; offsets: {family: first column}
    of families that use near lists."""

    run: object
    ids: tuple
    columns: np.ndarray
    size: int
    offsets: dict = field(default_factory=dict)

    def __call__(self, *arguments) -> dict:
        return self.run(*arguments)


@lru_cache(maxsize=64)
def _print_of(problem) -> str | None:
    try:
        return fingerprint(problem)
    except Unknown:
        return None


@lru_cache(maxsize=128)
def _of_object(problem, *how) -> Program:
    return _build(problem, None, *how)


@lru_cache(maxsize=128)
def _of_print(key, held, *how) -> Program:
    return _build(held.problem, key, *how)


@dataclass(frozen=True)
class _Held:
    """A problem that is equal to any other: what it is stands in the key beside it."""

    problem: object = field(compare=False)

    def __hash__(self):
        return 0


def compiled(
    problem: Complementarity | Filippov,
    n: int,
    samples: int,
    method: str,
    style: str,
    capacity: tuple[int, ...] = (),
) -> Program:
    """The program for states of size n at so many sample times. Raises NotTraceable."""
    key = _print_of(problem)
    how = (n, samples, method, style, capacity)
    return _of_object(problem, *how) if key is None else _of_print(key, _Held(problem), *how)


def _build(problem, key, n, samples, method, style, capacity):
    from nsbench.solvers.penalty.forces import layout

    ids, columns, size, offsets = layout(problem, n, style, capacity)
    particles = [problem.constraints[k].particles(n) for k in offsets]
    trace = lambda: _traced(problem, n, samples, method, style, capacity, particles)
    if key is not None:
        key = "|".join(map(str, (key, n, samples, method, style, capacity)))
    return Program(program(key, trace), tuple(ids), columns, size, offsets)


def _traced(problem, n, samples, method, style, capacity, particles):
    """jax.stages.Lowered. Raises NotTraceable with the reason of the first function that fails."""
    jax = float64()
    import jax.numpy as jnp

    from nsbench.solvers.penalty.forces import slopes
    from nsbench.solvers.penalty.integrator import integrator

    real = lambda *shape: jax.ShapeDtypeStruct(shape, jnp.float64)
    whole = jax.ShapeDtypeStruct((), jnp.int64)
    lists = tuple(
        jax.ShapeDtypeStruct((N, c), jnp.int64) for N, c in zip(particles, capacity, strict=True)
    )
    made = slopes(problem, n, style, capacity)
    try:
        out = jax.eval_shape(made.f, 0.0, real(n), 1.0, lists)
    except NotTraceable:
        raise
    except (TypeError, AttributeError, IndexError, ValueError, NotImplementedError) as e:
        raise NotTraceable(describe_jax_error(e)) from None
    wrong = next((o.dtype for o in out if o.dtype != jnp.float64), None)
    if wrong is not None:
        raise NotTraceable(f"they return {wrong}, float64 is needed")
    near = (lists, real(n), real()) if style == "near" else ()
    with jax.default_device(
        jax.devices("cpu")[0]
    ):  # a loop of tiny operations: an accelerator only adds latency
        run = integrator(made, method, n, STATES_BETWEEN if isinstance(problem, Filippov) else 0)
        return jax.jit(run).lower(
            real(n + made.size),
            whole,
            real(),
            real(),
            real(samples),
            real(),
            real(),
            real(n + made.size),
            whole,
            near,
        )
