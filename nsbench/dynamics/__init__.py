"""nsbench/dynamics"""
