"""nsbench/solvers/euler/kernels"""
