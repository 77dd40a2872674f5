"""Integrate one smooth arc to its first event, in Python.

arc: steps and their checks. stepper: calls of an integrator. integrators: their table. pieces:
proof that nothing is missed on a step, defect test where there is no proof. crossings: location of
events. stall: steps that no longer lead anywhere. stiffness: steps that the equation bounds.
failure_status: why a step failed.
"""
