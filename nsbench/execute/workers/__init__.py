"""nsbench/execute/workers"""
