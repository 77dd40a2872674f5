"""nsbench/qp/kernels"""
