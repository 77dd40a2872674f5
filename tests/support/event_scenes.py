"""Scenes for tests of event-driven runs."""

import numpy as np

from nsbench import Affine, Case, Complementarity, Filippov


def scene(drift, *constraints, x0, t, **more):
    return Case(
        name="scene",
        problem=Complementarity(drift, constraints),
        x0=np.array(x0, float),
        t=np.asarray(t, float),
        **more,
    )


def relays(field, switch, x0, t):
    return Case(
        name="relays", problem=Filippov.signs(field, switch), x0=np.array(x0), t=np.array(t)
    )


def push(*force):
    """A constant drift."""
    v = np.array(force)
    return lambda xp: lambda t, x: v + 0.0 * x


def floor(b=0.0):
    return Affine(np.eye(1), np.array([b]))
