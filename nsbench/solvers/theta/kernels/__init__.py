"""Compiled time loop of implicit theta stepping."""
