"""Registered cases: one file, one case."""
