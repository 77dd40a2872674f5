"""Compile factories and kernels, and cache what was compiled.

decorators          the numba decorators of all kernels; importing them configures numba's cache
numba_cache         where kernels are stored, and which edits compile them again
garbage_collection  none while numba compiles
kernel_store        files of one kernel with checksums: damaged ones are compiled again
compile_lock        one process compiles a kernel, the others wait and load it
factories           a factory as a numpy function, as a numba function pointer, as a JAX function
user_forms          forms in which users write functions: arrays to fill, lists and tuples
function_pointer    pointers to compiled functions as arguments of kernels
cfunc_cache         machine code of such pointers on disk
jax_cache           compiled JAX programs in memory and on disk
jax_serialization   a JAX executable as bytes, without pickle
function_digest     digest of a function: code, closure, globals, recursively
disk_cache          checksummed files in the user's cache folder; the SHA-256 helper
installation        processor and versions of libraries
"""
