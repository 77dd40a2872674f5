"""What several methods share: time grid, start policy, binding of compiled loops, divergence,
extrapolation.
"""
