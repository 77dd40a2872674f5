"""nsbench/solvers/pbd/kernels"""
