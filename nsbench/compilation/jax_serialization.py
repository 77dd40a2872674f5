"""A compiled JAX program as bytes and back, without pickle: a line of JSON, then what XLA itself
writes of its machine code.

JAX's own way (jax.experimental.serialize_executable) is a pickle, and reading one runs whatever it
holds. Here the line says what goes in and out; XLA refuses code that it did not write. That machine
code is run is what a cache of programs is for: nsbench.compilation.jax_cache looks after who can
write there.

The classes that hold a program are no public part of JAX. Who reads or writes must expect any
exception from another version of it, and compile.
"""

from __future__ import annotations

import json
from collections.abc import Callable

import numpy as np

FORMAT = 1


def pack(compiled, lapack: bool) -> bytes:
    """An executable (jax.stages.Compiled) for one processor, of positional arguments, with a dict
    of results.

    lapack: whether it calls LAPACK's functions. Raises ValueError for a program that needs more
    than its code.
    """
    shell = compiled._executable._unloaded_executable
    arguments, named = compiled.args_info
    more = (
        named,
        shell.mut,
        shell.keepalive,
        shell.host_callbacks,
        shell.ordered_effects,
        shell.unordered_effects,
        compiled._params.const_args,
    )
    if any(more):
        raise ValueError("the program needs more than its code")
    results = dict(zip(sorted(compiled.out_info), map(_told, shell.output_avals), strict=True))
    head = {
        "format": FORMAT,
        "lapack": lapack,
        "name": shell.name,
        "arguments": _told(arguments),
        "results": results,
        "kept": sorted(shell.kept_var_idx),
    }
    code = compiled.runtime_executable()
    return json.dumps(head).encode() + b"\n" + code.client.serialize_executable(code)


def unpack(data: bytes) -> Callable:
    """The executable on the first processor. Raises whatever JAX or XLA says of bytes that are of
    no use to it."""
    import jax
    from jax._src.interpreters.pxla import UnloadedMeshExecutable
    from jax._src.lib import xla_client

    line, _, code = data.partition(b"\n")
    head = json.loads(line)
    if head["format"] != FORMAT:
        raise ValueError(f"format {head['format']}")
    if head["lapack"]:
        from jaxlib.lapack import prepare_lapack_call

        prepare_lapack_call("getrf", np.dtype(np.float64))
    cpu = jax.devices("cpu")[0]
    devices = xla_client.DeviceList((cpu,))
    here = jax.sharding.SingleDeviceSharding(cpu)
    arguments = _read(head["arguments"])
    every = jax.tree_util.tree_leaves(arguments)
    ins = [_aval(every[i]) for i in head["kept"]]
    results = {name: _read(leaf) for name, leaf in head["results"].items()}
    outs = [_aval(results[name]) for name in sorted(results)]
    shell = UnloadedMeshExecutable(
        xla_executable=cpu.client.deserialize_executable(code, executable_devices=devices),
        device_list=devices,
        backend=cpu.client,
        input_avals=ins,
        input_shardings=[here] * len(ins),
        output_avals=outs,
        output_shardings=[here] * len(outs),
        committed=False,
        name=head["name"],
        unordered_effects=[],
        ordered_effects=[],
        keepalive=[],
        host_callbacks=[],
        kept_var_idx=set(head["kept"]),
        mut=None,
        xla_in_layouts=[None] * len(ins),
        dispatch_in_layouts=[None] * len(ins),
        xla_out_layouts=[None] * len(outs),
        all_args_info=None,
        pgle_profiler=None,
    )
    info = jax.tree_util.tree_map(
        lambda leaf: jax.stages.ArgInfo(_aval(leaf), False), (arguments, {})
    )
    return jax.stages.Compiled(
        shell.load(), [], info, jax.tree_util.tree_structure(results), no_kwargs=True
    )


def _told(tree):
    """Tuples as lists, what stands in them as {dtype, shape}."""
    return (
        [_told(v) for v in tree]
        if isinstance(tree, tuple)
        else {"dtype": str(tree.dtype), "shape": list(tree.shape)}
    )


def _read(tree):
    """What `_told` wrote, its leaves as jax.ShapeDtypeStruct."""
    import jax

    if isinstance(tree, dict):
        return jax.ShapeDtypeStruct(tuple(tree["shape"]), np.dtype(tree["dtype"]))
    return tuple(_read(v) for v in tree)


def _aval(leaf):
    import jax

    return jax.core.ShapedArray(leaf.shape, leaf.dtype)
