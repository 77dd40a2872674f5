"""Arrays without reference counts, for the hot loops of kernels and for callbacks.

numba counts references to an array wherever it is bound, given to a function or taken out of a
tuple, by an atomic operation each; in a loop of short steps over a NamedTuple of twenty arrays they
take longer than the steps. Of a borrowed array there is nothing to count: LLVM removes it.
"""

from __future__ import annotations

from typing import TypeVar

from llvmlite.ir import DoubleType
from numba.core import cgutils, ir_utils, types
from numba.core.errors import TypingError
from numba.extending import intrinsic, overload
from numba.np.arrayobj import populate_array

Arrays = TypeVar("Arrays")


def borrowed(arrays: Arrays) -> Arrays:
    """Return an array, or a tuple of arrays and numbers, whose references are not counted.

    For arguments of a kernel, which its caller holds: numba drops a variable of the kernel's own
    after its last use, which this may be. What is borrowed must not be returned or kept. Raises
    numba's TypingError for a tuple with anything else in it.
    """
    return arrays


def _is_written_through(result, args, aliases, of_arguments):
    """Tell numba that a write to what was borrowed is one to the array, and no dead code."""
    ir_utils._add_alias(result, args[0].name, aliases, of_arguments)


ir_utils.alias_func_extensions[("borrowed", __name__)] = _is_written_through


@overload(borrowed, jit_options={"forceinline": True})
def _borrowed(arrays):
    return lambda arrays: _without_owner(arrays)


@intrinsic
def _without_owner(typing_context, arrays):
    def generate(context, builder, signature, args):
        return _released(context, builder, signature.args[0], args[0])

    if not _has_no_other_owner(arrays):
        raise TypingError(f"borrowed takes arrays and numbers; this is {arrays}")
    return arrays(arrays), generate


def _has_no_other_owner(kind):
    """Return whether arrays are all in a value whose references are counted."""
    if isinstance(kind, types.BaseTuple):
        return all(map(_has_no_other_owner, kind.types))
    return isinstance(kind, (types.Array, types.Number, types.Boolean))


def _released(context, builder, kind, value):
    """Return the value with null in place of the owner of every array in it."""
    if isinstance(kind, types.Array):
        array = context.make_array(kind)(context, builder, value)
        array.meminfo = cgutils.get_null_value(array.meminfo.type)
        array.parent = cgutils.get_null_value(array.parent.type)
        return array._getvalue()
    if isinstance(kind, types.BaseTuple):
        for i, member in enumerate(kind.types):
            item = builder.extract_value(value, i)
            value = builder.insert_value(value, _released(context, builder, member, item), i)
    return value


@intrinsic
def stack_array(typing_context, n):
    """Return an array of n floats on the stack, for a compiled function while it runs.

    It is not initialised. Its use ends with the function that asked for it; n is small.
    """
    kind = types.Array(types.float64, 1, "C")

    def generate(context, builder, signature, args):
        array = context.make_array(kind)(context, builder)
        itemsize = context.get_constant(types.intp, 8)
        data = builder.alloca(DoubleType(), size=args[0])
        populate_array(
            array, data=data, shape=[args[0]], strides=[itemsize], itemsize=itemsize, meminfo=None
        )
        return array._getvalue()

    return kind(types.intp), generate
