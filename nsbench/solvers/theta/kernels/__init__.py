"""nsbench/solvers/theta/kernels"""
