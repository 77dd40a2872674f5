"""Compiled loops of PBD: projections, sweeps, neighbour lists and cell storage."""
