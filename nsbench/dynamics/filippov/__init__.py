"""nsbench/dynamics/filippov"""
