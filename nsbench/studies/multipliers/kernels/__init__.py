"""Compiled loop of position-based dynamics with accumulated multipliers."""
