"""Serialise a compiled JAX program without pickle: a line of JSON, then XLA's machine code.

jax.experimental.serialize_executable writes a pickle, and reading one runs whatever it contains.
Here the line of JSON describes arguments and results, and XLA refuses code that it did not write.
That machine code is run is the purpose of a cache of programs: nsbench.compilation.jax_cache checks
who can write there.

jax.export with JAX's persistent cache, both public, would hold these programs too. Each process
then lowers the exported module again before it can ask that cache: fetching the program of
`three_discs` took 2.5 s instead of 0.45 s (measured side by side on a loaded machine), and it needs
the package flatbuffers and a setting of JAX for the whole process. So the classes that hold an
executable are used, which are no public part of JAX: a caller must expect any exception from
another version of it, and compile.
"""

from __future__ import annotations

import json
from collections.abc import Callable

import numpy as np

FORMAT = 1


def pack(compiled, lapack: bool) -> bytes:
    """Return an executable (jax.stages.Compiled) for one processor as bytes.

    It takes positional arguments and returns a dict. lapack: does it call LAPACK? Raises
    ValueError for a program that needs more than its code.
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
    results = dict(zip(sorted(compiled.out_info), map(_describe, shell.output_avals), strict=True))
    head = {
        "format": FORMAT,
        "lapack": lapack,
        "name": shell.name,
        "arguments": _describe(arguments),
        "results": results,
        "kept": sorted(shell.kept_var_idx),
    }
    code = compiled.runtime_executable()
    return json.dumps(head).encode() + b"\n" + code.client.serialize_executable(code)


def unpack(data: bytes) -> Callable:
    """Return the executable, loaded on the first processor.

    Raises whatever JAX or XLA raises for bytes that are of no use to it.
    """
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


def _describe(tree):
    """Describe a tree of arrays for JSON: tuples as lists, leaves as {dtype, shape}."""
    return (
        [_describe(v) for v in tree]
        if isinstance(tree, tuple)
        else {"dtype": str(tree.dtype), "shape": list(tree.shape)}
    )


def _read(tree):
    """Return the tree that `_describe` described, its leaves as jax.ShapeDtypeStruct."""
    import jax

    if isinstance(tree, dict):
        return jax.ShapeDtypeStruct(tuple(tree["shape"]), np.dtype(tree["dtype"]))
    return tuple(_read(v) for v in tree)


def _aval(leaf):
    import jax

    return jax.core.ShapedArray(leaf.shape, leaf.dtype)
