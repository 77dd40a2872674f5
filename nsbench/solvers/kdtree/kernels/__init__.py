"""nsbench/solvers/kdtree/kernels"""
