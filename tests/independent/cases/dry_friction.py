"""Oscillator with dry friction: half-cosines, then rest."""
import numpy as np

from nsbench import Case, Filippov


def drift(xp):
    def f(t, x, s):
        return xp.array([x[1], -x[0] - 0.5 * s[0]])
    return f


def switch(xp):
    def f(t, x):
        return xp.array([x[1]])
    return f


CASE = Case(name="dry_friction", problem=Filippov.signs(drift, switch), x0=np.array([3.3, 0.0]), t=np.linspace(0.0, 12.0, 49))
