"""Turn a factory, make(xp) -> f(t, x), into a numpy function, a numba cfunc or a JAX function.

A compiled drift is a C callback ``(t, x, out)``. A cached kernel gets a pointer to it
(nsbench.compilation.function_pointer): the kernel is compiled once for every drift and stored on
disk; the drift itself is compiled once per case, and stored too (nsbench.compilation.cfunc_cache).
"""

from __future__ import annotations

import functools
import types
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from nsbench.compilation.user_forms.draft_array import DraftNamespace, settled

if TYPE_CHECKING:
    import jax
    from numba.core.dispatcher import Dispatcher

    from nsbench.compilation.function_pointer import Pointer


# what a function of a case may return: numpy makes an array of it
Value = np.ndarray | Sequence | float


@dataclass(frozen=True)
class Scaling:
    """How a function in a case's own units comes from the user's.

        unit f(origin + time t, size x)

    It is the attribute `scaling` of the former, whose compiled callback then needs no temporary
    arrays. function: the user's; size, unit: one for each coordinate, or one for all.
    """

    function: Callable
    origin: float
    time: float
    size: np.ndarray
    unit: np.ndarray


class CompileError(Exception):
    """numba cannot compile a factory; the message says why."""


def as_numpy(factory: Callable) -> Callable:
    """Return the factory's function in numpy, called with times of numpy's type.

    A Python float divided by zero, as at a pole in time, would raise. Lists and tuples that it
    returns become arrays.
    """
    f = factory(np)

    def at(t: float, *args: np.ndarray) -> np.ndarray:
        value = f(np.float64(t) if type(t) is float else t, *args)
        return np.asarray(value) if isinstance(value, (list, tuple)) else value

    return at


def _pointer(factory, signature, make, make_scaled=None):
    """Return a pointer of `signature` to make(function): a cfunc, or one that was stored on disk.

    make: a function of this module, identified by its name; make_scaled(function, scaling, room)
    does the same for one that has a Scaling. Raises CompileError with numba's reason. The pointer
    is an address of machine code, so the caller keeps it alive (numba holds a reference).
    """
    from numba.core.errors import NumbaError

    from nsbench.compilation import cfunc_cache

    function = None
    try:
        function = factory(np)
        name = cfunc_cache.name_of(signature, make.__qualname__, function)
        found = cfunc_cache.load(name, signature)
        if found is not None:
            return found
        scaling = getattr(function, "scaling", None) if make_scaled else None
        if isinstance(scaling, Scaling):
            try:
                return _scaled_pointer(name, signature, make_scaled, scaling)
            except Exception:  # a number, say, which times `unit` is an array
                pass
        return cfunc_cache.compiled(name, signature, make(_compiled(function)))
    except (NumbaError, NotImplementedError) as e:
        raise CompileError(_reason(str(e))) from None
    except Exception as e:  # numba's code generator stops with errors of any kind
        # those of the factory, which is the user's own, and of the machine are none of numba's
        if function is None or isinstance(e, (OSError, MemoryError)):
            raise
        raise CompileError(f"numba stops with {type(e).__name__}: {_reason(str(e))}") from None


def _scaled_pointer(name, signature, make, scaling):
    """Return a pointer as _pointer does, to make(function, scaling, room).

    room: coordinates for which there is room on the stack; none for functions that go back to
    Python, which could keep an array.
    """
    from nsbench.compilation import cfunc_cache

    function = _compiled(scaling.function)
    found = cfunc_cache.compiled(name, signature, make(function, scaling, STACK))
    if cfunc_cache.stands_alone(found.owner):
        return found
    return cfunc_cache.compiled(None, signature, make(function, scaling, 0))


def _reason(text: str) -> str:
    """Return what numba cannot compile, with the line of the file, from the text of its error."""
    lines = [line.strip() for line in text.strip().splitlines()]
    said = [line for line in lines if line and not line.startswith("Failed in nopython mode")]
    call = next((line.removeprefix(">>> ") for line in lines if line.startswith(">>> ")), "")
    what = f"no implementation of {call}" if call else next(iter(said), lines[0] if lines else "")
    at = next((line for line in lines if line.startswith("File ") and '", line ' in line), "")
    number = at.rstrip(":").rpartition("line ")[2]
    return f"{what}, line {number}" if number else what


def _for_callbacks(f):
    """Compile a function that callbacks alone call."""
    import numba

    from nsbench.compilation.inner_compiler import COMPILER

    return numba.njit(
        no_cpython_wrapper=True, no_cfunc_wrapper=True, pipeline_class=COMPILER
    )(f)


def _compiled(f, callers=()):
    """Compile the function for compiled callers alone, with the closures that it calls.

    numba calls compiled functions only. A field made of modes is a tree of closures; each closure
    cell that holds a Python function is compiled first, but for `callers`, which it would call in a
    circle: numba reports those.
    """
    if hasattr(f, "py_func"):  # compiled by whoever wrote it
        return f
    if not isinstance(f, types.FunctionType):
        raise CompileError(f"an object of class {type(f).__qualname__} is no function of Python")
    if f.__closure__:
        callers = (*callers, f)
        cells = []
        for cell in f.__closure__:
            try:
                v = cell.cell_contents
            except ValueError:
                raise CompileError(f"{f.__qualname__} closes over a name without a value") from None
            cells.append(
                types.CellType(
                    _compiled(v, callers)
                    if isinstance(v, types.FunctionType) and v not in callers
                    else v
                )
            )
        f = types.FunctionType(f.__code__, f.__globals__, f.__name__, f.__defaults__, tuple(cells))
    return _for_callbacks(f)


def _types():
    from numba import types as of

    return of.void, of.float64, of.float64[::1]


STACK = 512  # coordinates whose scaled values lie on the stack


def _scaled_state(size, room):
    """Return a kernel (x) -> size x, on the stack of its caller if there is room for it."""
    import numba

    from nsbench.compilation.borrowed_arrays import stack_array

    def scaled(x: np.ndarray) -> np.ndarray:
        y = stack_array(x.size) if x.size <= room else np.empty(x.size)
        for i in range(x.size):
            y[i] = size[i if size.size > 1 else 0] * x[i]
        return y

    # numba inlines it: the stack is that of the callback
    return numba.njit(inline="always")(scaled)


def _store_scaled(unit):
    """Return a kernel that writes unit v to `out`, or nothing if v is neither as long nor one."""
    from nsbench.compilation.user_forms.sequences import vector

    def store(value: Value, out: np.ndarray) -> None:
        v = vector(value)
        for i in range(out.size if v.size == out.size or v.size == 1 else 0):
            out[i] = unit[i if unit.size > 1 else 0] * v[i if v.size > 1 else 0]

    return _for_callbacks(store)


def _fill_scaled(f, scaling, room):
    """Return the function that rhs_cfunc compiles of one with a Scaling."""
    origin = scaling.origin
    time = scaling.time
    state = _scaled_state(np.ravel(scaling.size), room)
    store = _store_scaled(np.ravel(scaling.unit))

    def fill(t: float, x: np.ndarray, out: np.ndarray) -> None:
        for i in range(out.size):
            out[i] = np.nan
        store(f(origin + time * t, state(x)), out)

    return fill


def _fill_scaled_signed(f, scaling, room):
    """Return the function that signed_rhs_cfunc compiles of one with a Scaling."""
    origin = scaling.origin
    time = scaling.time
    state = _scaled_state(np.ravel(scaling.size), room)
    store = _store_scaled(np.ravel(scaling.unit))

    def fill(t: float, x: np.ndarray, s: np.ndarray, out: np.ndarray) -> None:
        for i in range(out.size):
            out[i] = np.nan
        store(f(origin + time * t, state(x), s), out)

    return fill


@functools.lru_cache(maxsize=256)
def rhs_cfunc(factory: Callable, n: int) -> Pointer:
    """``drift(xp) -> (t, x)`` as a cfunc (t, x, out), x and out (n,)."""
    from nsbench.compilation.user_forms.sequences import vector

    void, f8, vec = _types()

    def make(f: Callable) -> Callable:
        def fill(t: float, x: np.ndarray, out: np.ndarray) -> None:
            for i in range(out.size):
                out[i] = np.nan  # what is left if f raises: a callback cannot pass an exception on
            v = vector(f(t, x))
            # element by element: assigning a slice takes two seconds to compile in each process
            for i in range(out.size if v.size == out.size or v.size == 1 else 0):
                out[i] = v[i if v.size > 1 else 0]

        return fill

    return _pointer(factory, void(f8, vec, vec), make, _fill_scaled)


@functools.lru_cache(maxsize=256)
def signed_rhs_cfunc(factory: Callable, n: int, d: int) -> Pointer:
    """Compile ``field(xp) -> (t, x, s)`` as a cfunc (t, x, s, out)."""
    from nsbench.compilation.user_forms.sequences import vector

    void, f8, vec = _types()

    def make(f: Callable) -> Callable:
        def fill(t: float, x: np.ndarray, s: np.ndarray, out: np.ndarray) -> None:
            for i in range(out.size):
                out[i] = np.nan
            v = vector(f(t, x, s))
            for i in range(out.size if v.size == out.size or v.size == 1 else 0):
                out[i] = v[i if v.size > 1 else 0]

        return fill

    return _pointer(factory, void(f8, vec, vec, vec), make, _fill_scaled_signed)


@functools.lru_cache(maxsize=256)
def curve_cfunc(factory: Callable, size: int) -> Pointer:
    """Compile ``b(xp) -> (t) -> array`` as a cfunc (t, out), out flat of the given size."""
    from nsbench.compilation.user_forms.sequences import vector

    void, f8, vec = _types()

    def make(f: Callable) -> Callable:
        def fill(t: float, out: np.ndarray) -> None:
            for i in range(out.size):
                out[i] = np.nan
            v = vector(f(t))
            for i in range(out.size if v.size == out.size or v.size == 1 else 0):
                out[i] = v[i if v.size > 1 else 0]

        return fill

    return _pointer(factory, void(f8, vec), make)


def constant_curve() -> Pointer:
    """Return a pointer to (t, out) that does nothing: walls at rest."""
    return _still()


@functools.cache
def _still():
    from nsbench.compilation.decorators import cfunc

    void, f8, vec = _types()

    def nothing(t: float, out: np.ndarray) -> None:
        return

    return cfunc(void(f8, vec))(nothing)


def without_compilation(function: Dispatcher, made: dict | None = None) -> Callable:
    """Return a kernel as a Python function, those it calls included.

    For one small call compilation would take seconds.
    """
    made = {} if made is None else made
    if function not in made:
        source = function.py_func
        names = dict(source.__globals__)
        made[function] = types.FunctionType(
            source.__code__, names, source.__name__, source.__defaults__
        )
        for name in source.__code__.co_names:
            if hasattr(names.get(name), "py_func"):
                names[name] = without_compilation(names[name], made)
    return made[function]


def as_jax(factory: Callable) -> Callable:
    """Return the factory's function in jax.numpy, in float64, with arrays to fill.

    Its values are arrays. It raises NotTraceable, with the user's line, where it is none of JAX.
    """
    import jax

    if not jax.config.jax_enable_x64:
        jax.config.update("jax_enable_x64", True)
    import jax.numpy as jnp

    from nsbench.compilation.user_forms.jax_errors import NotTraceable, describe_jax_error

    f = factory(DraftNamespace(jnp))

    def at(*args: float | jax.Array) -> jax.Array:
        try:
            return jnp.asarray(settled(f(*args)))
        except (TypeError, AttributeError, IndexError, ValueError, NotImplementedError) as e:
            raise NotTraceable(describe_jax_error(e)) from e

    return at
