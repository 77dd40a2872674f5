"""What numba compiles of its own library beside a kernel: no strings, no machine code."""

from __future__ import annotations

import numpy as np
import pytest
from numba.core import event

from nsbench.compilation.decorators import njit
from nsbench.compilation.inner_compiler import LinkedLibrary
from nsbench.compilation.library_functions import MESSAGE


class Compiled(event.Listener):
    """Dispatchers that numba compiles, in order."""

    def __init__(self):
        self.dispatchers = []

    def on_start(self, event: event.Event) -> None:
        self.dispatchers.append(event.data["dispatcher"])

    def on_end(self, event: event.Event) -> None:
        """Nothing."""


def compiled_with(function, *args):
    """Return the compiled function, and what else its first call with the arguments compiled."""
    listener = Compiled()
    compiled = njit(function)
    with event.install_listener("numba:compile", listener):
        compiled(*args)
    return compiled, [d for d in listener.dispatchers if d is not compiled]


def test_an_assignment_to_a_slice_compiles_no_strings():
    def put(out: np.ndarray, values: np.ndarray) -> None:
        out[1:] = values

    out = np.zeros(3)
    put_compiled, others = compiled_with(put, out, np.ones(2))
    assert out.tolist() == [0.0, 1.0, 1.0]
    assert not [d for d in others if "unicode" in d.py_func.__module__]
    with pytest.raises(ValueError, match=MESSAGE):
        put_compiled(out, np.ones(3))


def test_functions_of_numpy_are_linked_into_the_kernel_that_calls_them():
    def ends(n: int) -> float:
        return np.full(n, 2.0).max() + np.arange(n).max()

    compiled, others = compiled_with(ends, 5)
    assert compiled(5) == 6.0
    libraries = [c.library for d in others for c in d.overloads.values()]
    assert libraries
    assert all(isinstance(x, LinkedLibrary) and not x._has_machine_code for x in libraries)
