"""One thread for every library, set before any of them is imported; Ctrl-C is heard even where a
shell started the tests in the background."""

import os
import signal

import pytest

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")
if (
    signal.getsignal(signal.SIGINT) is signal.SIG_IGN
):  # what tests start would inherit it, and not be interrupted
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session", autouse=True)
def kernels_compiled_once(request, tmp_path_factory):
    """Where several processes run the tests, each kernel is compiled by one of them."""
    if "PYTEST_XDIST_WORKER" in os.environ:
        from kernel_warmup import compile_once

        shared = tmp_path_factory.getbasetemp().parent
        compile_once(shared / "kernel_locks", len(request.session.items))


@pytest.fixture(autouse=True)
def solver_files_forgotten(monkeypatch):
    """What a test registers is not there in the next one, in whatever order and process they
    come."""
    from nsbench.solvers import registry

    monkeypatch.setattr(registry, "_loaded", {})
    monkeypatch.setattr("nsbench.study.attempt._files_loaded", set())


@pytest.fixture(autouse=True)
def runs_prepared_anew(monkeypatch):
    """A test that changes a method and solves a case again is not given what was prepared before.

    tests/solvers/test_prepared_runs.py has a store of its own."""
    from nsbench.solvers import registry
    from nsbench.solvers.common.prepared_runs import PreparedRuns

    monkeypatch.setattr(registry, "_prepared", PreparedRuns(max_runs=0))


@pytest.fixture
def runs_here(monkeypatch):
    """Rows that `nsbench run` asks for are made in this process, without the start of a worker."""
    from runs_here import patch_runs

    patch_runs(monkeypatch)


@pytest.fixture
def interpreted(monkeypatch):
    """Kernels call the numpy functions of cases, without compiling them."""
    from interpreted_physics import patch_pointers

    patch_pointers(monkeypatch)
