"""Smooth: two equations without any constraint, to see that a method is a consistent Euler at all.

    x1' = x1,           x1(0) = 1      exact  e^t
    x2' = -x2 + sin t,  x2(0) = 1      exact  3/2 e^-t + (sin t - cos t) / 2

Explicit Euler's global error is known to first order in h (Lady Windermere's fan): each local error h^2 x''/2 is
carried to time t by the flow, so for x1 it is  h/2 * t e^t  below the solution. Here T = 2: 7.4 h.
"""
import numpy as np

from nsbench import Case, Complementarity

RATE, FORCED = np.array([1.0, -1.0]), np.array([0.0, 1.0])


def drift(xp):
    def f(t, x):
        return RATE * x + FORCED * xp.sin(t)
    return f


def exact(t):
    return np.stack((np.exp(t), 1.5 * np.exp(-t) + 0.5 * (np.sin(t) - np.cos(t))), axis=1)


CASE = Case(
    name="smooth",
    problem=Complementarity(drift),
    x0=np.array([1.0, 1.0]),
    t=np.linspace(0.0, 2.0, 41),
    exact=exact, exact_events=(), substeps=8, tags=("seed",),
)
