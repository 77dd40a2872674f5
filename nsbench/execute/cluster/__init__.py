"""nsbench/execute/cluster"""
