"""nsbench/linalg"""
