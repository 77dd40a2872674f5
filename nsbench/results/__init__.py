"""nsbench/results"""
