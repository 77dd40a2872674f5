"""Kernels get functions of a case as pointers: one kernel for all, and no Python in a call."""

import gc
import importlib
import pickle
import sys
import weakref
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest
from numba import float64, typeof, void

from nsbench.compilation.case_functions import entry_point, loop_in_python
from nsbench.compilation.decorators import cfunc, inner_kernel, njit
from nsbench.compilation.function_pointer import pointer_to
from nsbench.compilation.inner_compiler import LinkedLibrary

SIGNATURE = void(float64, float64[::1], float64[::1])
X = np.array([0.3, -0.7, 1.9])


def times(number):
    """A pointer to (t, x, out): out = number t x."""

    def fill(t, x, out):
        for i in range(out.size):
            out[i] = number * t * x[i]

    return cfunc(SIGNATURE)(fill)


TWICE = times(2.0)
THRICE = times(3.0)


class Functions(NamedTuple):
    first: Callable
    second: Callable


@inner_kernel
def composed(functions: Functions, t: float, x: np.ndarray, out: np.ndarray) -> None:
    """Call one function after the other."""
    between = np.empty(x.size)
    functions.first(t, x, between)
    functions.second(t, between, out)


@njit
def compose(first, second, t, x, out):
    """Call one function after the other, from a kernel within."""
    composed(Functions(first, second), t, x, out)


@njit
def twice(t, x, out):
    """Call a function that is a global constant."""
    TWICE(t, x, out)


def value(call, *functions):
    out = np.full(X.size, 7.0)
    call(*functions, 0.5, X, out)
    return out


def test_one_kernel_calls_all_functions_of_a_signature():
    assert typeof(TWICE) == typeof(THRICE) == pickle.loads(pickle.dumps(typeof(TWICE)))
    assert typeof(TWICE) != typeof(cfunc(void(float64, float64[::1]))(lambda t, out: None))
    assert np.array_equal(value(compose, TWICE, THRICE), 1.5 * X)
    assert np.array_equal(value(compose, THRICE, THRICE), 1.5 * (1.5 * X))
    assert len(compose.overloads) == 1
    assert np.array_equal(value(twice), X)


def test_a_call_runs_no_python():
    """Numba's own functions as arguments are looked up by Python, each time."""
    called = []
    out = np.empty(X.size)
    args = (TWICE, THRICE, 0.5, X, out)
    entry = entry_point(compose, args)
    sys.setprofile(lambda frame, event, arg: called.append((event, frame.f_code.co_name)))
    entry(*args)
    sys.setprofile(None)
    assert [name for event, name in called if event == "call"] == []


def test_kernels_that_call_pointers_are_linked_without_machine_code():
    value(compose, TWICE, THRICE)
    (compiled,) = composed.overloads.values()
    assert isinstance(compiled.library, LinkedLibrary) and not compiled.library._has_machine_code


def test_the_kernel_on_disk_serves_other_functions(tmp_path, monkeypatch):
    """The type by which numba finds it is of the signature alone."""
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr("numba.config.CACHE_DIR", str(tmp_path / "cache"))
    name = "kernel_that_calls_a_pointer"
    text = "from numba import njit\n@njit(cache=True)\ndef call(f, t, x, out):\n    f(t, x, out)\n"
    (tmp_path / f"{name}.py").write_text(text)
    for pointer, factor, hits in ((TWICE, 1.0, 0), (times(8.0), 4.0, 1)):
        kernel = importlib.import_module(name).call
        del sys.modules[name]
        assert np.array_equal(value(kernel, pointer), factor * X)
        assert sum(kernel.stats.cache_hits.values()) == hits


def test_a_pointer_keeps_its_machine_code():
    pointer = times(5.0)
    held = weakref.ref(pointer.owner)
    gc.collect()
    assert held() is not None and np.array_equal(value(compose, pointer, pointer), 2.5 * (2.5 * X))
    del pointer
    gc.collect()
    assert held() is None


@pytest.mark.parametrize("other", [None, 7, test_a_call_runs_no_python])
def test_what_is_no_pointer_is_refused(other):
    """What entry_point returns does not look at types."""

    @njit
    def call_after_zero(f, t, x, out):
        if t > 0.0:
            f(t, x, out)

    arrays = (X, np.empty(X.size))
    entry = entry_point(call_after_zero, (TWICE, 0.5, *arrays))
    with pytest.raises(AttributeError, match="address"):
        entry(other, -0.5, *arrays)
    with pytest.raises(TypeError):
        entry(type("Other", (), {"address": "0"})(), -0.5, *arrays)


def test_the_python_form_takes_python_functions():
    def fill(t, x, out):
        out[:] = 2.0 * t * x

    @njit
    def call(f, t, x, out):
        f(t, x, out)

    assert np.array_equal(value(loop_in_python(call), fill), value(call, TWICE))
    assert np.array_equal(value(call, pointer_to(TWICE.owner)), X)
