"""nsbench/solvers/event_driven/lcs"""
