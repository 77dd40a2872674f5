"""Compiled Gauss-Seidel sweep over given pairs of discs."""
