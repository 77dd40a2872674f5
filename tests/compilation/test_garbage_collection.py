"""Python's collector is off while numba compiles, and afterwards as it was."""

import gc
import threading

import pytest
from numba import njit
from numba.core import event

import nsbench.compilation.decorators  # noqa: F401  (pauses the collector)


class Watch(event.Listener):
    def __init__(self):
        self.seen = []

    def on_start(self, _):
        self.seen.append(gc.isenabled())

    def on_end(self, _):
        self.seen.append(gc.isenabled())


@pytest.fixture
def watch():
    watched = Watch()
    with event.install_listener("numba:compile", watched):
        yield watched
    gc.enable()


def function(k):
    @njit
    def f(x):
        return x + k

    return f


def test_the_collector_is_off_while_kernels_compile(watch):
    threads = [threading.Thread(target=function(k), args=(1.0,)) for k in range(4)]
    for t in threads:
        t.start()
    for t in threads:
        t.join()
    assert len(watch.seen) == 8 and not any(watch.seen)
    assert gc.isenabled()


def test_it_stays_as_it_was(watch):
    gc.disable()
    function(0.5)(1.0)
    assert not gc.isenabled()


def test_it_is_on_again_after_a_kernel_that_does_not_compile(watch):
    with pytest.raises(Exception, match="cannot unify|Failed in nopython|No implementation"):
        function("text")(1.0)
    assert watch.seen and gc.isenabled()
