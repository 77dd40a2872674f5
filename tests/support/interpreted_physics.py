"""Physics of cases as callbacks into Python: nothing of a case is compiled.

numba takes a quarter of a second and more to compile the drift, field or curve of each case that a
test makes up. Where a test asks what is said of a run, and not how fast its functions are, the
fixture `interpreted` has kernels call the numpy functions of the case instead: the same loops, by
the same kind of pointer. That compiled functions have the values of numpy is shown for every case
of the catalogue (tests/case/test_cases.py).
"""

import contextlib
import ctypes
import functools

import numpy as np
from numba.core import types as of

from nsbench.compilation import factories
from nsbench.compilation.function_pointer import Pointer

# numba hands an array of one dimension over as seven words: two owners, the number of its items and
# their size, the address of the data, shape and stride
ARRAY_WORDS = 7
DATA = 4
SHAPE = 5


def pointer(factory, signature, make, make_scaled=None):
    """As nsbench.compilation.factories._pointer, of a function that Python calls."""
    function = factory(np)
    fill = make(function)
    scalar = [kind is of.float64 for kind in signature.args]

    def call(*words):
        rest = iter(words)
        with np.errstate(all="ignore"), contextlib.suppress(Exception):  # compiled ones are silent
            fill(*(np.float64(next(rest)) if one else _array(rest) for one in scalar))

    words = [
        kind
        for one in scalar
        for kind in ([ctypes.c_double] if one else [ctypes.c_int64] * ARRAY_WORDS)
    ]
    callback = ctypes.CFUNCTYPE(None, *words)(call)
    address = ctypes.cast(callback, ctypes.c_void_p).value
    return Pointer(address, signature, callback)


def _array(rest):
    """The array of the next words."""
    words = [next(rest) for _ in range(ARRAY_WORDS)]
    return _view(words[DATA], words[SHAPE])


@functools.lru_cache(1000)
def _view(address, size):
    """The numbers at an address, whoever has written them."""
    return np.frombuffer((ctypes.c_double * size).from_address(address)) if size else np.empty(0)


def patch_pointers(monkeypatch):
    """Kernels call numpy functions of cases, until the patch is undone."""
    monkeypatch.setattr("nsbench.compilation.factories._pointer", pointer)
    monkeypatch.setattr("nsbench.compilation.user_forms.sequences.vector", np.ravel)
    for name in ("rhs_cfunc", "signed_rhs_cfunc", "curve_cfunc"):
        compiled = getattr(factories, name)
        monkeypatch.setattr(factories, name, functools.lru_cache(256)(compiled.__wrapped__))
