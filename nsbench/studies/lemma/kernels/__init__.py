"""Compiled evaluation and search of worst cases of one sweep."""
