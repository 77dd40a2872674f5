"""What one run could leave behind in a process, and the next one would find: put back before each
run.

Global random state, numpy's error state, working directory, environment, locale, rounding of the
processor, settings of JAX, where output goes, filters of warnings, timers. A run begins as in a
fresh process, and with the same random numbers in each.
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
from collections.abc import Callable

import numpy as np

from nsbench.execute.workers.output_capture import mark

SEED = 0  # of global random numbers: a method that draws from them draws the same in each run
QUIET = (
    DeprecationWarning,
    PendingDeprecationWarning,
    ImportWarning,
    ResourceWarning,
)  # for developers, not of a run


class ProcessState:
    """Taken when a worker starts; output: a descriptor to which everything is written that runs
    print, with marks of this word between them."""

    def __init__(self, output: int, word: bytes):
        self.output = output
        self.word = word
        self.environ, self.folder, self.path = dict(os.environ), os.getcwd(), [*sys.path]
        self.errors, self.locale = np.geterr(), locale.setlocale(locale.LC_ALL)
        self.depth = sys.getrecursionlimit()
        self.print = np.get_printoptions()
        self.jax: dict = {}
        self.streams: dict = {}
        self.warned: set[tuple] = set()
        self._lib = ctypes.CDLL(None) if os.name == "posix" else None
        if "jax" in sys.modules:
            self.note_jax()
        else:
            sys.meta_path.insert(0, _AtImport("jax", self.note_jax))

    def restore(self, begins: bool = True) -> None:
        """Put back everything. begins: a run does, nothing has warned yet; else the same one goes
        on."""
        self._process()
        self._output()
        self.draw_anew()
        np.seterr(**self.errors)
        np.set_printoptions(**self.print)
        self.warned = set() if begins else self.warned
        self._warnings()
        self._settings_of_jax()

    def draw_anew(self) -> None:
        """Global random numbers from their beginning (imports during a preparation draw some, in
        the first process only)."""
        np.random.seed(SEED)  # noqa: NPY002 - it is the global state that plugins draw from
        random.seed(SEED)

    def _process(self):
        with contextlib.suppress(OSError):  # the folder may be gone: then nobody can be there
            os.chdir(self.folder)
        for name in [n for n in os.environ if n not in self.environ]:
            del os.environ[name]
        for name, value in self.environ.items():
            if os.environ.get(name) != value:
                os.environ[name] = value
        sys.path[:] = self.path
        sys.setrecursionlimit(self.depth)
        locale.setlocale(locale.LC_ALL, self.locale)
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides what Ctrl-C means
        if hasattr(signal, "setitimer"):
            signal.setitimer(signal.ITIMER_REAL, 0.0)
        if hasattr(self._lib, "fesetenv"):
            self._lib.fesetenv(ctypes.c_void_p(-1))  # FE_DFL_ENV: to nearest, no flush to zero

    def _output(self):
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

    def _warnings(self):
        warned = self.warned

        def count(message, category, filename, lineno, file=None, line=None):
            if not category.__name__.startswith(
                "Numba"
            ):  # of a compilation: not every process compiles
                warned.add((category, filename, lineno))
                with contextlib.suppress(OSError, ValueError):
                    sys.stderr.write(
                        warnings.formatwarning(message, category, filename, lineno, line)
                    )

        warnings.resetwarnings()  # places that have warned before will warn again
        warnings.simplefilter("default")
        for category in QUIET:
            warnings.simplefilter("ignore", category)
        warnings.showwarning = count

    def _settings_of_jax(self):
        if self.jax:
            import jax

            for name, value in jax.config.values.items():
                if name in self.jax and value != self.jax[name]:
                    jax.config.update(name, self.jax[name])

    def note_jax(self) -> None:
        """JAX was imported just now: in float64, as the package has it, whoever imported it."""
        import jax

        jax.config.update("jax_enable_x64", True)
        self.jax.update(jax.config.values)

    def prints(self, i: int) -> None:
        """From here on it is run i that prints; what was printed before, by Python or by C, is in
        the descriptor."""
        for stream in (sys.stdout, sys.stderr):
            with contextlib.suppress(OSError, ValueError, AttributeError):
                stream.flush()
        if self._lib is not None:
            self._lib.fflush(None)
        os.write(self.output, mark(self.word, i))


class _AtImport:
    """A finder of modules that calls `then` when `name` has been imported, before anyone can have
    changed it."""

    def __init__(self, name: str, then: Callable[[], None]):
        self.name = name
        self.then = then

    def find_spec(self, name, path=None, target=None):
        if name != self.name:
            return None
        sys.meta_path.remove(self)
        spec = importlib.util.find_spec(name)
        if spec is not None and spec.loader is not None:
            plain = spec.loader.exec_module

            def load(module):
                plain(module)
                self.then()

            spec.loader.exec_module = load
        return spec
