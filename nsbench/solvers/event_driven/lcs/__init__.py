"""Integrate linear complementarity systems between events: arcs with w = 0 on a fixed set of rows.

loop: arcs. row_choice: the rows of the next one. modes: linear flow on a set of rows. linear_flow:
its integration by Radau collocation, with sign changes.
"""
