"""Digest of a function: its code, what it closes over, the globals it names, and so on recursively.

Two functions with one digest compute the same, in this process or another: the digest is the key
of compiled programs on disk. Whatever cannot be distinguished for certain (an object of an unknown
class, a module that is no known library, random numbers) has no digest: `Unknown` is raised, and
the program is then found by the text of what was traced, at the price of tracing.
"""

from __future__ import annotations

import builtins
import dataclasses
import dis
import functools
import hashlib
import platform
import types

import numpy as np

from nsbench.compilation.machine_and_libraries import version
from nsbench.source_files.package import package_digest

LIBRARIES = ("numpy", "jax", "math", "scipy", "cmath", "operator", "functools", "itertools")
PURE = frozenset(
    "abs all any bool dict divmod enumerate float int isinstance len list map max min pow range "
    "reversed "
    "round set slice sorted sum tuple zip str frozenset complex".split()
)
PLAIN = (type(None), bool, int, float, complex, str, bytes, type(Ellipsis))
UNCERTAIN = frozenset(
    ("random", "default_rng", "RandomState", "fromfile", "load", "loadtxt", "genfromtxt", "memmap")
)


class Unknown(Exception):
    """Something that has no digest; the message says what."""


def fingerprint(*values: object) -> str:
    """Return the digest of the values: 64 hexadecimal digits. Raises Unknown."""
    h = hashlib.sha256()
    _put(h, values, {})
    return h.hexdigest()


def _put(h, v, seen):
    def tag(*words: object) -> None:
        for w in words:
            b = w if isinstance(w, bytes) else str(w).encode()
            h.update(len(b).to_bytes(8, "little") + b)

    if isinstance(v, PLAIN):
        tag(type(v).__name__, repr(v))
    elif isinstance(v, np.generic) or (type(v) is np.ndarray and v.dtype.kind in "fiubc"):
        tag("array", v.dtype.str, np.shape(v), np.ascontiguousarray(v).tobytes())
    elif isinstance(v, (tuple, list)) and type(v) in (tuple, list):
        tag(type(v).__name__, len(v))
        for e in v:
            _put(h, e, seen)
    elif isinstance(v, (set, frozenset)) and all(isinstance(e, (str, int)) for e in v):
        tag("set", sorted(map(repr, v)))
    elif type(v) in (dict, types.MappingProxyType):
        tag("dict", len(v))
        for k, e in v.items():
            _put(h, (k, e), seen)
    elif isinstance(v, slice):
        tag("slice", repr(v))
    elif isinstance(v, np.ufunc) or isinstance(v, types.BuiltinFunctionType):
        tag("built in", getattr(v, "__module__", None) or "numpy", v.__name__)
        if not isinstance(v, np.ufunc) and (v.__module__ or "numpy").partition(".")[0] not in (
            *LIBRARIES,
            "builtins",
        ):
            raise Unknown(f"the function {v.__name__} of {v.__module__}")
    elif isinstance(v, types.ModuleType):
        _library(tag, v.__name__)
    elif isinstance(v, functools.partial):
        tag("partial")
        _put(h, (v.func, v.args, v.keywords), seen)
    elif isinstance(v, types.FunctionType):
        _function(h, tag, v, seen)
    elif type(v).__module__.startswith("numba.") and isinstance(
        getattr(v, "py_func", None), types.FunctionType
    ):
        tag("compiled")
        _put(h, (v.targetoptions, v.py_func), seen)
    elif isinstance(v, type):
        tag("class", v.__qualname__)
        if v.__module__ != "builtins":
            _library(tag, v.__module__)
    elif dataclasses.is_dataclass(v) and type(v).__module__.startswith("nsbench."):
        tag("data", type(v).__qualname__)
        _library(tag, type(v).__module__)
        _put(h, [getattr(v, f.name) for f in dataclasses.fields(v)], seen)
    elif type(v).__module__.startswith("scipy.sparse") and hasattr(v, "tocsr"):
        m = v.tocsr()
        _put(h, ("sparse", m.shape, m.indptr, m.indices, m.data), seen)
    else:
        raise Unknown(f"an object of {type(v).__module__}.{type(v).__qualname__}")


def _library(tag, name):
    top = name.partition(".")[0]
    if top == "nsbench" and not name.startswith("nsbench.cases"):
        tag("module", name, package_digest())
    elif top in LIBRARIES:
        tag("module", name, version(top), platform.python_version())
    else:
        raise Unknown(f"the module {name}")


def _function(h, tag, f, seen):
    if f.__module__ and f.__module__.partition(".")[0] in LIBRARIES:
        tag("function", f.__module__, f.__qualname__)
        _library(tag, f.__module__)
        return
    if id(f) in seen:  # it calls itself, or is met again
        tag("again", seen[id(f)])
        return
    seen[id(f)] = len(seen)
    tag("function")
    _put(h, (f.__defaults__, f.__kwdefaults__), seen)
    try:
        cells = [c.cell_contents for c in f.__closure__ or ()]
    except ValueError:
        raise Unknown(f"an empty cell of {f.__qualname__}") from None
    _code(h, tag, f.__code__, f.__globals__, seen)
    _put(h, cells, seen)


def _code(h, tag, code, space, seen):
    tag(
        "code",
        code.co_code,
        code.co_argcount,
        code.co_kwonlyargcount,
        code.co_flags,
        code.co_names,
        code.co_varnames,
        code.co_freevars,
        code.co_cellvars,
        getattr(code, "co_exceptiontable", b""),
    )
    if UNCERTAIN & set(code.co_names):
        raise Unknown(f"{sorted(UNCERTAIN & set(code.co_names))[0]} in {code.co_name}")
    for op in dis.get_instructions(code):
        if op.opname in ("LOAD_GLOBAL", "LOAD_NAME"):
            name = op.argval
            if name in space:
                tag("global", name)
                _put(h, space[name], seen)
            elif name not in PURE and not _is_exception(name):
                raise Unknown(f"the name {name} in {code.co_name}")
        elif op.opname == "IMPORT_NAME":
            _library(tag, op.argval)
        elif op.opname.startswith(("STORE_GLOBAL", "DELETE_GLOBAL")):
            raise Unknown(f"a global that {code.co_name} changes")
    for c in code.co_consts:
        if isinstance(c, types.CodeType):
            _code(h, tag, c, space, seen)
        else:
            _put(h, c, seen)


def _is_exception(name):
    v = getattr(builtins, name, None)
    return isinstance(v, type) and issubclass(v, BaseException)
