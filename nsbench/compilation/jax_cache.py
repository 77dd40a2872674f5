"""Compiled JAX programs in the user's cache folder: a second process need not even trace.

A program is found by the digest of what it was made from (nsbench.compilation.function_digest), of
this package, of the libraries that trace and compile, of JAX's settings and of the processor. Where
there is no digest it is traced and found by the text of what was traced. JAX's own settings, its
cache among them, are left as the user has them. A file that cannot be read is no error: the program
is compiled again. NSBENCH_CACHE=off keeps programs off the disk.
"""

from __future__ import annotations

import functools
import os
import re
import types
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from nsbench.compilation import disk_cache
from nsbench.compilation.disk_cache import digest
from nsbench.compilation.jax_serialization import pack, unpack
from nsbench.compilation.machine_and_libraries import machine, version
from nsbench.source_files.package import package_digest

# functions outside the program: LAPACK's must be looked up before it runs; any other (a callback
# into this process, say) would be missing in the next process, so such a program is not stored
CALLS = re.compile(r"custom_call @?\"?([A-Za-z0-9_.$]+)")
TRACERS = ("jax", "jaxlib", "diffrax", "equinox", "optimistix", "lineax", "numpy")


def float64() -> types.ModuleType:
    """Import JAX and set it to float64; return the module."""
    import jax

    if not jax.config.jax_enable_x64:
        jax.config.update("jax_enable_x64", True)
    return jax


@dataclass
class CachedProgram:
    """An executable; again() compiles it anew, where this one was read from the disk."""

    run: Callable
    again: Callable | None = None

    def __call__(self, *arguments) -> dict:
        """Return the results as numpy arrays.

        A program from the disk that does not run is compiled again, once.
        """
        import jax

        float64()
        try:
            return {name: np.asarray(v) for name, v in self.run(*arguments).items()}
        except jax.errors.JaxRuntimeError:
            if self.again is None:
                raise
        self.run = self.again()
        self.again = None
        return self(*arguments)


def program(key: str | None, trace: Callable) -> CachedProgram:
    """Return the executable for `key`.

    trace() -> jax.stages.Lowered is called where it is not on the disk, or key is None.
    """
    name = None if key is None else digest("made from", key, _platform())
    found = _load(name)
    if found is not None:
        return CachedProgram(found, lambda: _compiled(trace(), name, fresh=True))
    lowered = trace()
    if name is None:
        name = digest("traced", lowered.as_text(), _platform())
        found = _load(name)
        if found is not None:
            return CachedProgram(found, lambda: _compiled(trace(), name, fresh=True))
    return CachedProgram(_compiled(lowered, name))


def _compiled(lowered, name: str, fresh: bool = False):
    """Compile, and store under `name` if possible. fresh: what is stored now is of no use."""
    if fresh:
        disk_cache.remove(folder(), name)
    calls = set(CALLS.findall(lowered.as_text()))
    found, ours = _compile(lowered)
    if ours and all(c.startswith("lapack_") for c in calls):
        _save(name, found, bool(calls))
    return found


def _compile(lowered):
    """Return the executable, and whether it was compiled here.

    What JAX's own cache returns, where the user has one, cannot be written again: it would lack its
    functions when it is read.
    """
    before = len(_watch_cache())
    return lowered.compile(), len(_watch_cache()) == before


@functools.cache
def _watch_cache() -> list:
    """Return a list that grows with each hit of JAX's own cache in this process."""
    import jax

    hits = []
    jax.monitoring.register_event_listener(
        lambda event, **_: hits.append(event) if event.endswith("/cache_hits") else None
    )
    return hits


def _platform() -> str:
    """Return a digest of everything but the program that an executable depends on."""
    jax = float64()
    settings = {k: v for k, v in jax.config.values.items() if "cache" not in k}
    return digest(
        *(f"{n} {version(n)}" for n in TRACERS),
        package_digest(),
        repr(sorted(settings.items(), key=str)),
        os.environ.get("XLA_FLAGS", ""),
        machine(),
    )


def folder() -> Path | None:
    """Return the folder of programs, or None."""
    return disk_cache.cache_folder("programs")


def _load(name):
    body = disk_cache.read(folder(), name)
    if body is None:
        return None
    try:
        return unpack(body)
    # whatever is wrong with the file, or with this JAX's idea of it: the program is compiled again
    except Exception:
        return None


def _save(name, compiled, lapack: bool) -> None:
    """Store an executable and whether it calls LAPACK; where that fails only time is lost."""
    if folder() is None or name is None:
        return
    try:
        body = pack(compiled, lapack)
    except Exception:  # an executable that cannot be written
        return
    disk_cache.write(folder(), name, body)
