"""nsbench/dynamics/contacts"""
