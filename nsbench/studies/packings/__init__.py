"""Packings of touching discs and spheres, orders of their contacts, and the linearised sweep."""
