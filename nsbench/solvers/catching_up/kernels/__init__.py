"""Compiled loop of the catching-up scheme and its candidate constraints."""
