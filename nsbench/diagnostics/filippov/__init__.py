"""Checks of runs of Filippov systems: late exits, repulsive and dependent surfaces, motions not
unique.
"""
