"""Compiled event loop for contacts: Taylor series between events, first events, active sets.

loop: arcs. series_step: one step. taylor_flow: series of the constrained flow. first_event:
isolation of events. active_set_change: next active set where it is certain. held_set: factor of the
active contacts. constraint_rows: gaps and gradients for Python. loop_state: named state and codes.
"""
