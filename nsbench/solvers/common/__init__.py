"""nsbench/solvers/common"""
