"""nsbench/solvers/event_driven/contacts"""
