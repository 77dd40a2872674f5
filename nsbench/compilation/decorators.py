"""The numba decorators of this package: importing them configures numba's cache.

`njit` is numba's own, but that Python alone calls by address what it compiles; `cfunc` returns a
pointer to what it compiles, as an argument of kernels (nsbench.compilation.function_pointer).
Every kernel takes them from here, so that numba knows where to store kernels, and when they are
current, before it compiles one (nsbench.compilation.numba_cache).

Functions that only compiled functions call take `inner_kernel`, `fused_kernel` or `summing_kernel`:
they get no machine code of their own (nsbench.compilation.inner_compiler). `inlined` ones are
copied into their callers before numba infers types. None is stored on disk: their callers are, with
their code in them. Where Python has to call one after all, in the loops of functions that numba
cannot compile, `python_entry` makes an entry.

Other things cost time to compile: arrays assigned to arrays (the message on shapes alone is put
together by 25 functions on strings), literals as arguments (one version of the function for each),
functions of numpy on arrays. Hence `one`, and loops.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import TYPE_CHECKING

import numba
import numpy as np

from nsbench.compilation import numba_cache  # noqa: F401  (configures numba)
from nsbench.compilation.function_pointer import Pointer, pointer_to
from nsbench.compilation.inner_compiler import INNER

if TYPE_CHECKING:
    from numba.core.dispatcher import Dispatcher
    from numba.core.typing.templates import Signature

__all__ = [
    "python_entry",
    "cfunc",
    "fused_kernel",
    "inlined",
    "inner_kernel",
    "njit",
    "one",
    "summing_kernel",
]

_inner = functools.partial(numba.njit, error_model="numpy", **INNER)
inner_kernel = _inner()
# dot products may be summed in lanes
summing_kernel = _inner(fastmath={"reassoc", "contract"})
inlined = numba.njit(error_model="numpy", inline="always")
# LLVM inlines it into its caller, where reference counts of borrowed arrays vanish
fused_kernel = _inner(forceinline=True)
njit = functools.partial(numba.njit, no_cfunc_wrapper=True)


def cfunc(signature: Signature, **options: object) -> Callable[[Callable], Pointer]:
    """Compile a function that kernels call by its address, once it is decorated."""
    return lambda f: pointer_to(numba.cfunc(signature, **options)(f))


@inner_kernel
def one() -> int:
    """Return 1 that is no literal."""
    return np.int64(1)


@functools.cache
def python_entry(kernel: Dispatcher) -> Dispatcher:
    """Return the kernel with an entry from Python: itself, or compiled for that and stored."""
    options = dict(kernel.targetoptions)
    if not options.pop("no_cpython_wrapper", False):
        return kernel
    return numba.jit(cache=True, **options)(kernel.py_func)
