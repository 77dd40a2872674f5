"""Kernels as Python functions, for one pytest process: -p interpreted_kernels.

A mutant of a kernel costs a minute of compilation before the first test of it begins. Interpreted,
a kernel is slow, but a test that runs it in a small scene ends within seconds, and coverage.py
sees which lines of it ran. What fails here must be an assertion of a test: an exception of Python
(an index out of range, a division of Python's floats by zero) is not what compiled code does.
"""

import signal

import numba
import numpy as np
import pytest


def as_python(function):
    """Return a function with what callers ask of a compiled one."""
    function.py_func = function
    function.compile = lambda types: function
    function.address = 0
    return function


def decorator(*args, **options):
    """Stand for numba.njit and numba.cfunc."""
    return as_python(args[0]) if args and hasattr(args[0], "__code__") else as_python


numba.njit = numba.cfunc = decorator
numba.typeof = lambda value: None
np.seterr(all="ignore")  # as compiled code, which is silent


@pytest.fixture(autouse=True)
def python_pointers(monkeypatch):
    """Functions of cases are called as they are."""
    from nsbench.compilation import factories

    def pointer(factory, signature, make):
        return as_python(make(factory(np)))

    monkeypatch.setattr(factories, "_pointer", pointer)
    monkeypatch.setattr(factories, "_still", lambda: lambda t, out: None)
    for name in ("rhs_cfunc", "signed_rhs_cfunc", "curve_cfunc"):
        monkeypatch.setattr(factories, name, getattr(factories, name).__wrapped__)


def pytest_addoption(parser):
    parser.addoption("--cpu", type=float, default=20.0, help="CPU seconds of a test")


def pytest_collection_modifyitems(config, items):
    """Leave out drawn examples: hypothesis counts on ending its tests itself."""
    items[:] = [i for i in items if not getattr(i.obj, "is_hypothesis_test", False)]


@pytest.hookimpl(wrapper=True)
def pytest_runtest_setup(item):
    return (yield from in_time(item))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item):
    return (yield from in_time(item))


def in_time(item):
    """Skip a test that is too slow without compilation."""

    def late(signum, frame):
        raise TooSlow

    signal.signal(signal.SIGPROF, late)
    # once: a lock may be held when it comes again
    signal.setitimer(signal.ITIMER_PROF, item.config.getoption("--cpu"))
    try:
        return (yield)
    except TooSlow:
        pytest.skip("takes too long in Python")
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)


class TooSlow(BaseException):
    """A test took longer than --cpu: no code under test may take it for an error of its own."""
