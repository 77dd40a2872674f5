"""nsbench/compilation"""
