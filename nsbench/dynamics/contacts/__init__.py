"""Evaluate constraint families: candidate contacts, gaps, gradients, rates, tolerances."""
