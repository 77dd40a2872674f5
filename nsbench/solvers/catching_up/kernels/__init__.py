"""nsbench/solvers/catching_up/kernels"""
