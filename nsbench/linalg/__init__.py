"""Compiled linear algebra: dense systems, rank, skyline, sparse and multifrontal factorisations.

Arrays in and arrays out. Skyline and multifrontal: Cholesky; sparse: L D L^T.
"""
