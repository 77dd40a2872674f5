"""Compiled kernels of the error bars."""
