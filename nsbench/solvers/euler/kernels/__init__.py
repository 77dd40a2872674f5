"""Compiled kernels of Euler's method: the time loops and one implicit step."""
