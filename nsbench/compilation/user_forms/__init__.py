"""Forms in which users write functions of a case, where an array namespace does not take them.

draft_array  arrays that functions fill entry by entry, where a namespace has no assignment
sequences    lists and tuples that functions return, stack and join, for numba
jax_errors   which line JAX cannot trace, and what to write instead
"""
