"""nsbench/diagnostics"""
