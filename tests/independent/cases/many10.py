"""Ten independent tides with incommensurate frequencies."""
import numpy as np

from nsbench import Affine, Case, Complementarity


def drift(xp):
    def f(t, x):
        return xp.array(
            [
                xp.cos(1.00 * t + 0.0) - 0.10,
                xp.cos(1.37 * t + 0.3) - 0.12,
                xp.cos(1.74 * t + 0.6) - 0.14,
                xp.cos(2.11 * t + 0.9) - 0.16,
                xp.cos(2.48 * t + 1.2) - 0.18,
                xp.cos(2.85 * t + 1.5) - 0.20,
                xp.cos(3.22 * t + 1.8) - 0.22,
                xp.cos(3.59 * t + 2.1) - 0.24,
                xp.cos(3.96 * t + 2.4) - 0.26,
                xp.cos(4.33 * t + 2.7) - 0.28,
            ]
        )
    return f


CASE = Case(
    name="many10",
    problem=Complementarity(drift, (Affine(A=np.eye(10), b=np.zeros(10)),)),
    x0=np.array([0.50, 0.55, 0.60, 0.65, 0.70, 0.75, 0.80, 0.85, 0.90, 0.95]),
    t=np.linspace(0.0, 15.0, 61),
)
