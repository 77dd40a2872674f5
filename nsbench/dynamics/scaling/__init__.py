"""A case in its own units: times, coordinates and multipliers of size one.

estimate     the sizes of a motion, found before it is run
scaled_case  the case in those units, and its results in the user's
"""
