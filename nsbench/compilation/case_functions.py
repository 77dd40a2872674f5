"""Bind a loop to the functions of a case: compile it, or run the same source in Python.

A loop is a numba kernel whose first arguments are functions of the case: the drift (t, x, out), the
field (t, x, s, out), curves (t, out). Where numba compiles all of them, they are
pointers, and the kernel, compiled once for every case, calls them. Where it
cannot compile one, the same source runs in Python around functions that fill `out` from numpy. Both
give the same bits; stats["loop"] says which it was ("compiled" or "host").
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from types import FunctionType

import numpy as np

from nsbench.compilation import factories


@dataclass(frozen=True)
class CaseFunction:
    """A function of a case in two forms, neither of them built yet.

    pointer() -> a function pointer, or factories.CompileError; in_python() -> a Python
    function with the same arguments. at(t, x) -> those at a state but for the array that it fills,
    of `size` numbers; None: it cannot raise.
    """

    pointer: Callable[[], object]
    in_python: Callable[[], Callable]
    at: Callable[[float, np.ndarray], tuple] | None = None
    size: int = 0


@dataclass(frozen=True)
class LoopFunctions:
    """The functions that a time loop calls, in the order of its first arguments.

    loop: "compiled" where they are pointers, "host" where they are Python functions. stats: what a
    run says of it.
    """

    functions: tuple
    loop: str
    stats: dict


COMPILED = {"loop": "compiled"}  # what a run says of a compiled loop


def in_python(reason: str) -> dict:
    """Return what a run says of a loop that ran in Python, and why it did."""
    return {"loop": "host", "note": f"The loop ran in Python, which is slower: {reason}."}


def drift_function(drift: Callable, n: int) -> CaseFunction:
    """Describe ``drift(xp) -> (t, x)`` as a function (t, x, out), x and out (n,)."""
    return CaseFunction(
        lambda: factories.rhs_cfunc(drift, n),
        lambda: _filling(factories.as_numpy(drift)),
        lambda t, x: (t, x),
        n,
    )


def signed_field(field: Callable, n: int, d: int) -> CaseFunction:
    """Describe ``field(xp) -> (t, x, s)`` as a function (t, x, s, out), x and out (n,), s (d,)."""
    return CaseFunction(
        lambda: factories.signed_rhs_cfunc(field, n, d),
        lambda: _filling(factories.as_numpy(field)),
        lambda t, x: (t, x, np.ones(d)),
        n,
    )


def curve_function(
    curve: Callable | None, size: int, in_numpy: Callable | None = None
) -> CaseFunction:
    """Describe ``curve(xp) -> (t)`` as a function (t, out), out flat of the given size.

    curve None: constant in time, a function that leaves `out` as it is. in_numpy: (t) -> the values
    where the curve is not compiled, if that is not curve(numpy).
    """
    if curve is None:
        return CaseFunction(factories.constant_curve, lambda: _leave)
    return CaseFunction(
        lambda: factories.curve_cfunc(curve, size),
        lambda: _filling(in_numpy or factories.as_numpy(curve)),
        lambda t, x: (t,),
        size,
    )


def compile_functions(*functions: CaseFunction, start: tuple | None = None) -> LoopFunctions:
    """Compile the functions, or build all of them in Python where numba cannot compile one.

    start: time and state at which they are called once, so that one that is compiled but raises
    counts as one that cannot be.
    """
    try:
        pointers = tuple(f.pointer() for f in functions)
        if start is not None:
            _call_once(functions, pointers, float(start[0]), np.array(start[1]))
        return LoopFunctions(pointers, "compiled", COMPILED)
    except factories.CompileError as e:
        stats = in_python(f"numba cannot compile the functions of the case ({e})")
        return LoopFunctions(tuple(f.in_python() for f in functions), "host", stats)


def _call_once(functions, pointers, t, x):
    """Raise CompileError if a compiled function raises at (t, x), and not in Python."""
    from nsbench.compilation.first_call import error_in_compiled_code

    for function, pointer in zip(functions, pointers, strict=True):
        if function.at is not None:
            args = function.at(t, x)
            why = error_in_compiled_code(pointer, function.in_python(), args, function.size)
            if why:
                raise factories.CompileError(why)


def _filling(function: Callable) -> Callable:
    """Write the values of (*args) -> array into the last argument, as a compiled callback does."""

    def fill(*args: float | np.ndarray) -> None:
        args[-1][:] = np.ravel(function(*args[:-1]))

    return fill


def _leave(t, out):
    """Leave `out` as it is: the curve is constant."""


def loop_in_python(kernel: Callable) -> Callable:
    """Return the loop in Python; the kernels that it calls stay compiled."""
    return _in_python(kernel, lambda value: value is kernel)


def module_in_python(kernel: Callable) -> Callable:
    """Return the loop and the kernels of its own file in Python; those imported stay compiled."""
    return files_in_python(kernel, kernel.py_func.__module__)


def files_in_python(kernel: Callable, *files: str) -> Callable:
    """Return the loop and the kernels of these files, named as modules, in Python."""
    return _in_python(kernel, lambda value: value.py_func.__module__ in files)


def _in_python(kernel, is_interpreted):
    """Return a kernel in Python, with those that it calls and that are to be interpreted."""
    from nsbench.compilation.decorators import python_entry

    made: dict = {}

    def interpreted(function):
        if function not in made:
            source = function.py_func
            names = dict(source.__globals__)
            made[function] = FunctionType(
                source.__code__, names, source.__name__, source.__defaults__, source.__closure__
            )
            for name in source.__code__.co_names:
                if hasattr(value := names.get(name), "py_func"):
                    inside = is_interpreted(value)
                    names[name] = interpreted(value) if inside else python_entry(value)
        return made[function]

    return interpreted(kernel)


def entry_point(kernel: Callable, args: tuple) -> Callable:
    """Compile a kernel for the types of `args`; return what is called for them from then on.

    numba's dispatcher looks at the types of all arguments in each call, which costs more than some
    runs. What is returned does not: it takes arguments of these types and memory layouts alone.
    """
    from numba import typeof

    return kernel.compile(tuple(typeof(a) for a in args))


def bind_loop(
    kernel: Callable, loop: str, args: tuple, interpret: Callable = loop_in_python
) -> Callable:
    """Return the time loop, compiled for the types of `args` or, where loop is "host", in Python.

    args: all arguments of a call, or arguments of the same types: a compiled loop takes no others,
    and does not look (see entry_point). interpret: which of the kernels below the loop run in
    Python as well: those that call the functions of the case.
    """
    return entry_point(kernel, args) if loop == "compiled" else interpret(kernel)
