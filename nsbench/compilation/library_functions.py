"""How numba compiles what it calls of its own library: without machine code or strings.

numba implements numpy's functions and Python's in Python, and compiles those that a kernel calls,
as if Python could call each of them (jit_registry says how). But kernels alone do: they take the
compiler of inner kernels.

An assignment of an array to a slice has a message on shapes, put together from both by 25 functions
on strings: they took longer to compile than most functions that contain one. Here the message names
no shape, as in numba's code for targets without strings.

Another numba, which lacks one of these names, compiles as it does.
"""

from __future__ import annotations

import functools
from collections.abc import Callable

import numba
from numba import extending
from numba.core import target_extension
from numba.np import arrayobj

from nsbench.compilation.inner_compiler import INNER

MESSAGE = "cannot assign an array to a slice of another shape"


@functools.wraps(numba.jit)
def inner_jit(*args: object, **options: object) -> Callable:
    """Compile a function of numba's library for compiled callers alone."""
    return numba.jit(*args, **{**INNER, **options})


def shapes_differ(source: tuple, slice_shape: tuple) -> None:
    """Raise ValueError, in compiled code."""
    raise NotImplementedError


@extending.overload(shapes_differ)
def _shapes_differ(source, slice_shape):
    def raise_without_shapes(source, slice_shape):
        raise ValueError(MESSAGE)

    return raise_without_shapes


def install() -> None:
    """Have numba compile its library so in this process."""
    registry = getattr(target_extension, "jit_registry", {})
    cpu = target_extension.target_registry["cpu"]
    if cpu in registry:
        del registry[cpu]  # it takes no second value for a key
        registry[cpu] = inner_jit
    if hasattr(arrayobj, "raise_with_shape_context"):
        arrayobj.raise_with_shape_context = shapes_differ
