"""Checks of runs with constraints: infeasible or degenerate constraints, and contacts passed
through.
"""
