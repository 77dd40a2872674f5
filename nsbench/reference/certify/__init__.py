"""Certificates: a proof, in ball arithmetic, that the event sequence of a run is the solution.

claimed_arcs (what a run claims) -> high_precision_path (follow it in 200 bits) -> error_bound
(distance from the solution, signs) -> certificate. Its numbers (ball_series, dual_numbers), arcs
and flows share nothing with the event-driven method on purpose.
"""
