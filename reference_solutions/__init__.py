"""Stored references: NAME.npz and NAME.json."""
