"""Pointers to compiled functions as arguments of kernels, at the cost of a number.

numba's own type of functions as arguments (FunctionType) has Python look up each address anew in
every call of a kernel, by a copy of the signature that it unpickles: 3 microseconds each, longer
than many steps of a small system. A FunctionPointer is the address alone. The call is the same: the
C function that numba makes of a cfunc, arrays as structures. Types of one signature are equal, so
that a kernel is compiled once for all functions.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from numba.core import cgutils, types
from numba.core.datamodel.models import ExternalFuncPointerModel
from numba.extending import NativeValue, register_model, unbox

if TYPE_CHECKING:
    from numba.core.ccallback import CFunc
    from numba.core.pythonapi import _UnboxContext
    from numba.core.typing.templates import Signature


class Pointer:
    """A compiled C function of a numba signature: its address, and what keeps its machine code.

    A kernel holds the address alone while it runs; its caller holds the pointer.
    """

    def __init__(self, address: int, signature: Signature, owner: object) -> None:
        self.address = address
        self.signature = signature
        self.owner = owner
        self._numba_type_ = FunctionPointer(signature)  # numba asks for it by this name


def pointer_to(callback: CFunc) -> Pointer:
    """Return the pointer to a compiled callback."""
    return Pointer(callback.address, callback._sig, callback)


def _address_of(pointer):
    return pointer.address


class FunctionPointer(types.ExternalFunctionPointer):
    """The type of a Pointer; numba calls one as it calls functions of C."""

    def __init__(self, signature: Signature) -> None:
        super().__init__(signature, _address_of)

    def __reduce__(self) -> tuple:
        """Pickle the signature alone, for numba's index of stored kernels."""
        return FunctionPointer, (self.sig,)


register_model(FunctionPointer)(ExternalFuncPointerModel)


@unbox(FunctionPointer)
def _unbox_address(kind: FunctionPointer, pointer: object, c: _UnboxContext) -> NativeValue:
    """Read the attribute `address`; what has none raises AttributeError."""
    builder = c.builder
    value_type = c.context.get_value_type(kind)
    found = cgutils.alloca_once_value(builder, cgutils.get_null_value(value_type))
    number = c.pyapi.object_getattr_string(pointer, "address")
    with cgutils.if_likely(builder, cgutils.is_not_null(builder, number)):
        address = c.pyapi.long_as_voidptr(number)
        c.pyapi.decref(number)
        builder.store(builder.bitcast(address, value_type), found)
    value = builder.load(found)
    return NativeValue(value, is_error=cgutils.is_null(builder, value))
