"""nsbench/diagnostics/contacts"""
