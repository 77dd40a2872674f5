"""nsbench/solvers/event_driven/filippov/kernels"""
