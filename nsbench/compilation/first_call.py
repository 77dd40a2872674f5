"""Call a compiled function of a case once, where the run starts, to see whether it raises.

A callback cannot pass an exception on: numba prints it and returns, and the run would end with NaN,
as if the drift were not finite. numba compiles some operations that it cannot do with every array,
such as reshape, which raises for one that is transposed.
"""

from __future__ import annotations

import sys
from collections.abc import Callable

import numpy as np

from nsbench.compilation.decorators import njit
from nsbench.compilation.function_pointer import Pointer


@njit(cache=True)
def _call_curve(f: Pointer, t: float, out: np.ndarray) -> None:
    f(t, out)


@njit(cache=True)
def _call_drift(f: Pointer, t: float, x: np.ndarray, out: np.ndarray) -> None:
    f(t, x, out)


@njit(cache=True)
def _call_field(f: Pointer, t: float, x: np.ndarray, s: np.ndarray, out: np.ndarray) -> None:
    f(t, x, s, out)


CALLS = {1: _call_curve, 2: _call_drift, 3: _call_field}


def error_in_compiled_code(pointer: Pointer, in_python: Callable, args: tuple, size: int) -> str:
    """Return what the compiled function raises that the same one in Python does not, else "".

    in_python: takes the arguments `args` and an array of `size` numbers to fill, as the pointer.
    """
    raised: list[BaseException] = []
    printed = sys.unraisablehook
    sys.unraisablehook = lambda unraisable: raised.append(unraisable.exc_value)
    try:
        CALLS[len(args)](pointer, *args, np.empty(size))
    finally:
        sys.unraisablehook = printed
    if not raised:
        return ""
    try:
        in_python(*args, np.empty(size))
    except Exception:  # it raises anyway: the case is at fault, which its check says
        return ""
    return f"compiled, it raises {type(raised[0]).__name__}: {raised[0]}"
