"""nsbench/reference/certify"""
