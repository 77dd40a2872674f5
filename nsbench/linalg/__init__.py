"""Compiled linear algebra, arrays in and arrays out: small dense systems, rank, skyline Cholesky,
sparse L D L^T and multifrontal Cholesky factorisations."""
