"""Answers of a report: the best method at an error, and what multipliers are worth."""
