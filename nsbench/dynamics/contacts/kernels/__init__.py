"""Compiled kernels for contacts: cell lists, order of a sweep, impulse records, arrays."""
