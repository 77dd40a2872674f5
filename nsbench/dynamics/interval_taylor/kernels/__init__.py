"""Compiled recurrences of interval Taylor arithmetic."""
