"""Shared by several methods: time grid, start, compiled loops, divergence, extrapolation."""
