"""Checks of runs with constraints: infeasible, degenerate or passed through."""
