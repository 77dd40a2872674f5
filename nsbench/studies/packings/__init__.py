"""Shared by the studies: packings of touching discs and spheres, orders, the linearised sweep."""
