"""nsbench/solvers/event_driven/smooth"""
