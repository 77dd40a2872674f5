"""A kernel that two processes come to together is compiled by one of them, and loaded by the
other."""

import multiprocessing as mp
import sys
import time

import pytest

from nsbench.compilation.compile_lock import lock_compilation

KERNELS = """
from numba import njit

@njit(cache=True)
def inner(x):
    return x + 1.0

@njit(cache=True)
def outer(x, depth):
    return inner(x) if depth == 0 else outer(x, depth - 1)
"""


def _use(folder, locks, ready, told):
    """Calls a kernel when the other process does; compiling takes a while."""
    from contextlib import contextmanager

    from numba.core import event

    entered = []
    waits = []

    @contextmanager
    def around():
        entered.append(1)
        yield

    class Slow(event.Listener):
        def on_start(self, _):
            time.sleep(0.5)

        def on_end(self, _):
            pass

    if locks:
        lock_compilation(locks, around, waits.append)
    sys.path.insert(0, folder)
    import kernels_of_two

    ready.wait()
    with event.install_listener("numba:compile", Slow()):
        value = kernels_of_two.outer(1.0, 2)
    told.put(
        [
            value,
            *(
                sum(k.stats.cache_misses.values())
                for k in (kernels_of_two.outer, kernels_of_two.inner)
            ),
            len(entered),
            max(waits, default=0.0),
        ]
    )


def together(folder, locks):
    spawn = mp.get_context("spawn")
    ready = spawn.Barrier(2)
    told = spawn.Queue()
    both = [spawn.Process(target=_use, args=(str(folder), locks, ready, told)) for _ in range(2)]
    for p in both:
        p.start()
    out = [told.get(timeout=120) for _ in both]
    for p in both:
        p.join()
    return out


@pytest.mark.long
def test_two_processes_compile_each_kernel_once(tmp_path, monkeypatch):
    (tmp_path / "kernels_of_two.py").write_text(KERNELS)
    (tmp_path / "locks").mkdir()
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "apart"))
    apart = together(tmp_path, "")
    assert [row[1] for row in apart] == [1, 1]  # what numba does by itself
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "shared"))
    shared = together(tmp_path, str(tmp_path / "locks"))
    assert sorted(row[1] for row in shared) == sorted(row[2] for row in shared) == [0, 1]
    assert all(
        row[0] == 2.0 and row[3] == 1 for row in shared
    )  # one report for a kernel and those it calls
    first, second = sorted(shared, key=lambda row: -row[1])
    assert second[4] > 0.4 > first[4]  # it waited while the first one compiled


def test_the_clock_stands_still_while_another_process_compiles():
    from nsbench.measure import clock

    def wait():
        start = time.perf_counter()
        time.sleep(0.2)
        clock.stand(time.perf_counter() - start)

    def prepare():
        wait()
        return wait

    run, spent = clock.prepared(prepare)
    assert (
        spent["setup_seconds"] + spent["compile_seconds"] < 0.1 and clock.first_call(run)[1] < 0.1
    )
