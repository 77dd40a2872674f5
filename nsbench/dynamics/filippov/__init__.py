"""Evaluate Filippov systems: sign patterns, sliding velocity, rates of switch functions, distance
to Filippov's set.
"""
