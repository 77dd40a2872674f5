"""Evaluate constraint families: candidate contacts, gaps, gradients, rates, and tolerances of
violations.
"""
