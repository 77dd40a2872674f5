"""Event-driven method on hybrid systems.

loop: arcs of one mode, joined by transitions, in Python.
"""
