"""Compiled kernels of the event-driven method for Filippov systems: Taylor steps and their loop.

An interpreter of traced programs in Taylor and interval Taylor arithmetic, and the loop over its
steps.
"""
