"""Compiled kernels of the event-driven method for Filippov systems: an interpreter of traced
programs in Taylor and interval Taylor arithmetic, and the loop over its steps."""
