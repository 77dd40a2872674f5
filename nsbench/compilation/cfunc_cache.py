"""Machine code of drifts on disk: a second process loads it instead of compiling.

numba's own cache identifies functions by file and line, and takes no closures, which drifts are.
Here a drift is found by its digest (function_digest), by this package, the libraries that compile,
their settings and the processor. A file is a line of JSON, which names the function, then the
object file that LLVM wrote; it is linked in an engine of its own, so that names of two drifts do
not clash. A drift without a digest, or whose code holds addresses of this process, is compiled in
each process. Nothing is unpickled to load one (numba unpickles what a drift raises when it is
raised: that is a part of its machine code).
"""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import TYPE_CHECKING

from llvmlite import binding as llvm
from numba.core import config
from numba.core.ccallback import CFunc
from numba.core.registry import cpu_target

from nsbench.compilation import disk_cache
from nsbench.compilation.function_digest import Unknown, fingerprint
from nsbench.compilation.function_pointer import Pointer, pointer_to
from nsbench.compilation.machine_and_libraries import machine, version
from nsbench.source_files.package import package_digest

if TYPE_CHECKING:
    from numba.core.typing.templates import Signature

FORMAT = 1
# settings of numba on which no machine code depends
HARMLESS_SETTINGS = ("CACHE_DIR", "NUM_THREADS", "DEFAULT_NUM_THREADS")
# in code that is bound to this process: a function that calls itself; an error with data in it
PROCESS_BOUND = (b".numba.unresolved", b"__excinfo_unwrap_args")


class _CompileResult:
    """Stands in for numba's cache of a callback, and stores the result of the compilation."""

    result = None

    def load_overload(self, signature: Signature, context: object) -> None:
        return None

    def save_overload(self, signature: Signature, result: object) -> None:
        self.result = result


def name_of(signature: Signature, what: str, function: Callable) -> str | None:
    """Return the name under which a function's machine code is stored; None: it has no digest.

    what: how the pointer is made of the function. Two functions of one name have the same code on
    this machine.
    """
    try:
        function_digest = fingerprint(function)
    except (Unknown, RecursionError):  # the latter: a list that contains itself
        return None
    settings = (
        f"{k}={v!r}"
        for k, v in sorted(vars(config).items())
        if k.isupper()
        and isinstance(v, (int, str, float))
        and k.removeprefix("NUMBA_") not in HARMLESS_SETTINGS
    )
    return disk_cache.digest(
        "pointer",
        str(FORMAT),
        what,
        str(signature),
        function_digest,
        package_digest(),
        *settings,
        *(f"{n} {version(n)}" for n in ("numba", "llvmlite", "numpy", "scipy")),
        *map(str, cpu_target.target_context.codegen().magic_tuple()),
        machine(),
    )


def load(name: str | None, signature: Signature) -> Pointer | None:
    """Return the pointer whose code is stored under the name; None if there is none of use."""
    body = disk_cache.read(disk_cache.cache_folder("pointers"), name)
    if body is None:
        return None
    head, _, code = body.partition(b"\n")
    try:
        header = json.loads(head)
        symbol = header["name"] if header["format"] == FORMAT else None
        part = llvm.ObjectFileRef.from_data(code)
        if symbol is None or not part._ptr:
            return None
        # the functions of numba's that such code calls have a name now
        cpu_target.target_context.refresh()
        engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), _machine())
        engine.add_object_file(part)
        engine.finalize_object()
        address = engine.get_function_address(symbol)
    except (
        ValueError,
        KeyError,
        TypeError,
        RuntimeError,
    ):  # no such line, or written by another LLVM: compiled again
        return None
    return Pointer(address, signature, engine) if address else None


def compiled(name: str | None, signature: Signature, function: Callable) -> Pointer:
    """Compile the callback, and store it under the name if its code can run in another process.

    Raises what numba raises.
    """
    callback = CFunc(function, (signature.args, signature.return_type), {}, {})
    found = _CompileResult()
    callback._cache = found
    callback.compile()
    if (
        name is not None
        and disk_cache.cache_folder("pointers") is not None
        and stands_alone(callback)
    ):
        code = found.result.library.serialize_using_object_code()[2][0]
        if not any(word in code for word in PROCESS_BOUND):
            head = {"format": FORMAT, "name": callback.native_name}
            disk_cache.write(
                disk_cache.cache_folder("pointers"), name, json.dumps(head).encode() + b"\n" + code
            )
    return pointer_to(callback)


def stands_alone(callback: CFunc) -> bool:
    """Return whether the code of a callback of `compiled` holds no addresses of this process and
    uses no Python objects."""
    result = callback._cache.result
    return not (
        result.library.has_dynamic_globals
        or result.reload_init
        or result.lifted
        or any(e.consts for e in (result.environment, *result._find_referenced_environments()))
    )


def _machine():
    """Return LLVM's target machine as numba sets it up."""
    codegen = cpu_target.target_context.codegen()
    options = {"opt": 3}
    codegen._customize_tm_options(options)
    return llvm.Target.from_triple(llvm.get_process_triple()).create_target_machine(**options)
