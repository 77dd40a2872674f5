"""Relay feedback: a resonant system of third order behind a relay, with fast swings and short sliding segments.

    x' = A x - b s,   s in Sgn(x1),   A = [[-(2 xi w + 1), 1, 0], [-(2 xi w + w^2), 0, 1], [-w^2, 0, 0]],
    b = (1, -2 sigma, 1),   x(0) = (0, -0.001, -0.02)

On x1 = 0 the state slides while |x2| <= 1, with s = x2; the sliding motion is unstable for sigma > 0 and leaves.
The start lies on the surface, inside the sliding segment. Phases of late events magnify early errors, which makes
the local slopes of fixed steps erratic. Piecewise linear: arcs are matrix exponentials, events are not elementary;
the reference is stored.
Source: Piiroinen & Kuznetsov, ACM TOMS 34 (2008) 13, equation (32); di Bernardo, Johansson & Vasca, Int. J.
Bifurcation Chaos 11 (2001) 1121-1140.
"""
import numpy as np

from nsbench import Case, Filippov

SUITES = {"hard": [{}]}


def output(xp):
    def c(t, x):
        return x[0:1]
    return c


def make(w: float = 25.0, xi: float = 0.05, sigma: float = 1.0, T: float = 10.0) -> Case:
    """w: frequency; xi: damping; sigma: zero of the plant; T: end time."""
    a1, a2, a3 = 2.0 * xi * w + 1.0, 2.0 * xi * w + w * w, w * w

    def drift(xp):
        def f(t, x):
            return xp.array([x[1] - a1 * x[0], x[2] - a2 * x[0], -a3 * x[0]])
        return f

    return Case(
        name="relay",
        problem=Filippov.relay(drift, np.array([[-1.0], [2.0 * sigma], [-1.0]]), output),
        x0=np.array([0.0, -0.001, -0.02]),
        t=np.linspace(0.0, T, 101),
        substeps=8,
    )
