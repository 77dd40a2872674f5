"""Reset what runs change in their process: random seeds, environment, folder, warnings, timers.

Global random state, numpy's error state, working directory, environment, locale, rounding of the
processor, settings of JAX, destination of output, filters of warnings, timers: what a run changes
there is restored before the next one, so that each run begins as in a fresh process, and with the
same random numbers.
"""

from __future__ import annotations

import contextlib
import ctypes
import importlib.util
import locale
import os
import random
import signal
import sys
import warnings
from collections.abc import Callable, Sequence
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import TextIO

import numpy as np

from nsbench.execute.workers.output_capture import mark
from nsbench.source_files import environment_reads

SEED = 0  # of the global random numbers: a method that uses them gets the same in each run
QUIET_CATEGORIES = (
    DeprecationWarning,
    PendingDeprecationWarning,
    ImportWarning,
    ResourceWarning,
)  # for developers, not of a run


class ProcessState:
    """State of the process as it was when a worker started.

    output: descriptor to which everything goes that runs print; word: of the marks between them
    (nsbench.execute.workers.output_capture).
    """

    def __init__(self, output: int, word: bytes):
        self.output = output
        self.word = word
        self.environ = dict(os.environ)
        self.folder = os.getcwd()
        self.path = [*sys.path]
        self.numpy_errors = np.geterr()
        self.locale = locale.setlocale(locale.LC_ALL)
        self.recursion_limit = sys.getrecursionlimit()
        self.print_options = np.get_printoptions()
        self.jax_settings: dict = {}
        self.streams: dict = {}
        self.warned: set[tuple] = set()  # (category, file, line) of warnings in the present run
        self._lib = ctypes.CDLL(None) if os.name == "posix" else None
        if "jax" in sys.modules:
            self.record_jax_settings()
        else:
            sys.meta_path.insert(0, _ImportHook("jax", self.record_jax_settings))

    def restore(self, begins: bool = True) -> None:
        """Restore everything.

        begins: a run begins, and no warning of it was counted yet; False: the same run goes on.
        """
        self._restore_process()
        self._restore_output()
        self.seed_random_numbers()
        np.seterr(**self.numpy_errors)
        np.set_printoptions(**self.print_options)
        if begins:
            self.warned = set()
        self._restore_warnings()
        self._restore_jax()

    def seed_random_numbers(self) -> None:
        """Seed the global random numbers again.

        Imports during a preparation draw some, and only in the first run of a process.
        """
        np.random.seed(SEED)  # noqa: NPY002 - it is the global state that plugins draw from
        random.seed(SEED)

    def _restore_process(self):
        with contextlib.suppress(OSError):  # the folder may be gone: then nobody can be there
            os.chdir(self.folder)
        for name in [n for n in os.environ if n not in self.environ]:
            del os.environ[name]
        for name, value in self.environ.items():
            if os.environ.get(name) != value:
                os.environ[name] = value
        environment_reads.forget_assignments()  # look-ups are inputs of the next run again
        sys.path[:] = self.path
        sys.setrecursionlimit(self.recursion_limit)
        locale.setlocale(locale.LC_ALL, self.locale)
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides what Ctrl-C means
        if hasattr(signal, "setitimer"):
            signal.setitimer(signal.ITIMER_REAL, 0.0)
        if hasattr(self._lib, "fesetenv"):
            self._lib.fesetenv(ctypes.c_void_p(-1))  # FE_DFL_ENV: to nearest, no flush to zero

    def _restore_output(self):
        for number, name in ((1, "stdout"), (2, "stderr")):
            os.dup2(self.output, number)
            if name not in self.streams or self.streams[name].closed:
                self.streams[name] = open(
                    number,
                    "w",
                    buffering=1,
                    closefd=False,
                    encoding="utf-8",
                    errors="backslashreplace",
                )
            setattr(sys, name, self.streams[name])
            setattr(sys, f"__{name}__", self.streams[name])

    def _restore_warnings(self):
        warned = self.warned

        def count(
            message: Warning | str,
            category: type[Warning],
            filename: str,
            lineno: int,
            file: TextIO | None = None,
            line: str | None = None,
        ) -> None:
            # numba warns while it compiles, and not every process compiles
            if not category.__name__.startswith("Numba"):
                warned.add((category, filename, lineno))
                with contextlib.suppress(OSError, ValueError):
                    sys.stderr.write(
                        warnings.formatwarning(message, category, filename, lineno, line)
                    )

        warnings.resetwarnings()  # places that have warned before will warn again
        warnings.simplefilter("default")
        for category in QUIET_CATEGORIES:
            warnings.simplefilter("ignore", category)
        warnings.showwarning = count

    def _restore_jax(self):
        if self.jax_settings:
            import jax

            for name, value in jax.config.values.items():
                if name in self.jax_settings and value != self.jax_settings[name]:
                    jax.config.update(name, self.jax_settings[name])

    def record_jax_settings(self) -> None:
        """Set JAX, which was imported just now, to float64 as the package does, and record."""
        import jax

        jax.config.update("jax_enable_x64", True)
        self.jax_settings.update(jax.config.values)

    def mark_output(self, i: int) -> None:
        """Write the mark after which run i prints, behind all that Python and C have buffered."""
        for stream in (sys.stdout, sys.stderr):
            with contextlib.suppress(OSError, ValueError, AttributeError):
                stream.flush()
        if self._lib is not None:
            self._lib.fflush(None)
        os.write(self.output, mark(self.word, i))


class _ImportHook:
    """A finder of modules that calls `then` as soon as `name` has been imported."""

    def __init__(self, name: str, then: Callable[[], None]):
        self.name = name
        self.then = then

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if name != self.name:
            return None
        sys.meta_path.remove(self)
        spec = importlib.util.find_spec(name)
        if spec is not None and spec.loader is not None:
            execute = spec.loader.exec_module

            def load(module: ModuleType) -> None:
                execute(module)
                self.then()

            spec.loader.exec_module = load
        return spec
