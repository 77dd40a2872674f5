"""How numba compiles functions that compiled functions alone call: without machine code.

numba optimises every function and turns it into machine code when it is compiled, and once more in
each caller, into which its code is linked. Of a function that nobody calls by its address the first
is wasted. Here it stays what LLVM calls a module: linked into its callers, optimised there.

A function that refers to its environment (it prints, or puts a message together) gets machine code
all the same: numba sets the environment there. A call from Python raises TypeError.
"""

from __future__ import annotations

import ctypes

from numba.core import codegen, compiler, typed_passes
from numba.core.compiler_machinery import LoweringPass, register_pass


class LinkedLibrary(codegen.JITCodeLibrary):
    """The code of one function, to be linked into that of its callers."""

    _has_machine_code = False

    def make_machine_code(self) -> None:
        """Do what numba does with every function."""
        self._has_machine_code = True
        super()._optimize_final_module()
        super()._finalize_final_module()

    def _optimize_final_module(self) -> None:
        """Leave it to the callers."""

    def _finalize_final_module(self) -> None:
        """Make the module ready for linking alone."""
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """Return what Python calls by the dispatcher: it raises TypeError."""
        self._ensure_finalized()
        return ctypes.cast(ctypes.pythonapi.PyErr_BadArgument, ctypes.c_void_p).value

    @property
    def codegen(self) -> EnvironmentsOnDemand:
        """Return what generates code, with a place for an environment where one is needed."""
        return EnvironmentsOnDemand(self)


class EnvironmentsOnDemand:
    """numba's code generator of a linked library."""

    def __init__(self, library: LinkedLibrary) -> None:
        self._library = library

    def __getattr__(self, name: str) -> object:
        return getattr(self._library._codegen, name)

    def set_env(self, name: str, environment: object) -> None:
        """Make machine code and set the environment if the function refers to it."""
        if str(self._library._final_module).count(name) > 1:  # the first declares it
            self._library.make_machine_code()
            self._library._codegen.set_env(name, environment)


@register_pass(mutates_CFG=False, analysis_only=True)
class LinkOnly(LoweringPass):
    """Have the function's code written to a linked library."""

    _name = "nsbench_link_only"

    def __init__(self) -> None:
        super().__init__()

    def run_pass(self, state: dict) -> bool:
        """Set the library before numba creates one."""
        state.library = LinkedLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()
        return False


class InnerCompiler(compiler.CompilerBase):
    """numba's compiler of functions that have no callers in Python (its `pipeline_class`)."""

    def define_pipelines(self) -> list:
        """Return numba's passes, with LinkOnly before the code is generated."""
        passes = compiler.DefaultPassBuilder.define_nopython_pipeline(self.state)
        passes.add_pass_after(LinkOnly, typed_passes.AnnotateTypes)
        passes.finalize()
        return [passes]


HOOKS = ("_optimize_final_module", "_finalize_final_module", "_ensure_finalized")
# another numba without these compiles such functions as all others
COMPILER = (
    InnerCompiler
    if all(hasattr(codegen.JITCodeLibrary, name) for name in HOOKS)
    else compiler.Compiler
)
# options of numba.jit for a function that compiled functions alone call
INNER = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True, "pipeline_class": COMPILER}
