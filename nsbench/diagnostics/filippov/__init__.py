"""Checks of runs of Filippov systems: late exits, special surfaces, motions that are not unique."""
