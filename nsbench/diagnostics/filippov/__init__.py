"""nsbench/diagnostics/filippov"""
