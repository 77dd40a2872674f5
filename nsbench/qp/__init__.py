"""nsbench/qp"""
