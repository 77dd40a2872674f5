"""Threads that wait for jobs: one word in memory says which job is at hand, another how many are
done with it.

Work is handed out many times in a step, so nobody sleeps in between: whoever waits looks at the
word again, and gives its processor away after some looks. numba has no atomic access to arrays on a
CPU; here it is, in three instructions.
"""

import ctypes
import os

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import make_array

from nsbench.compilation.decorators import njit

# places in `word`; those written by several lie 64 bytes apart
JOB = 0
POSTED = 8
DONE = 16
REST = 24
DIM = 25
ROW = 26
WORDS = 32
STOP = -1
LOOKS = 300  # before the processor is given away: about a microsecond


def _place(context, builder, signature, args):
    return cgutils.get_item_pointer(
        context,
        builder,
        signature.args[0],
        make_array(signature.args[0])(context, builder, args[0]),
        [args[1]],
    )


@intrinsic
def look(typing, word, k):
    """word[k], read after whatever the thread that wrote it had done before."""

    def code(context, builder, signature, args):
        return builder.load_atomic(_place(context, builder, signature, args), "acquire", 8)

    return types.int64(word, types.intp), code


@intrinsic
def raise_(typing, word, k):
    """word[k] += 1, seen by others after whatever this thread has done before."""

    def code(context, builder, signature, args):
        one = ir.Constant(ir.IntType(64), 1)
        return builder.atomic_rmw("add", _place(context, builder, signature, args), one, "acq_rel")

    return types.int64(word, types.intp), code


@intrinsic
def rest(typing, address):
    """Call the function without arguments at that address: `yielding()`."""

    def code(context, builder, signature, args):
        kind = ir.FunctionType(ir.IntType(32), [])
        return builder.call(builder.inttoptr(args[0], kind.as_pointer()), [])

    return types.int32(types.int64), code


def yielding() -> int:
    """Address of the system's function that gives the processor to another thread."""
    function = (
        ctypes.windll.kernel32.SwitchToThread if os.name == "nt" else ctypes.CDLL(None).sched_yield
    )
    return ctypes.cast(function, ctypes.c_void_p).value


def words() -> np.ndarray:
    """The words of a crew that has no job yet."""
    word = np.zeros(WORDS, np.int64)
    word[REST] = yielding()
    return word


@njit(cache=True, nogil=True)
def wait(word, k, least):
    """Return once word[k] >= least."""
    looks = 0
    while look(word, k) < least:
        looks += 1
        if looks > LOOKS:
            rest(word[REST])


@njit(cache=True, nogil=True)
def post(word, job):
    """Give out a job; to be called when the one before is done by all."""
    word[JOB] = job
    raise_(word, POSTED)


@njit(cache=True, nogil=True)
def finish(word, others):
    """Return when the `others` have done what was posted last."""
    wait(word, DONE, others * word[POSTED])
