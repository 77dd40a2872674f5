"""Event-driven method for Filippov systems: arcs in one mode, sliding included, and the next mode.

The next mode is chosen where a switching surface is reached.

A mode holds +1 or -1 where the state is on that side of surface i, 0 where it slides on it, and
FREE where it stays on a surface between equal fields. `program` traces the modes of a case,
`compiled_loop` follows them in compiled Taylor steps, `host_loop` in Python wherever that is not
possible.
"""
