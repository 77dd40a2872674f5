"""nsbench/solvers/event_driven/filippov"""
