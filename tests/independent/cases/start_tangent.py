"""On the floor at t = 0 with no push at first."""
import numpy as np

from nsbench import Affine, Case, Complementarity


def drift(xp):
    def f(t, x):
        return xp.array([xp.sin(t), -xp.sin(t), t**2 - 0.2 * t**3])
    return f


CASE = Case(
    name="start_tangent",
    problem=Complementarity(drift, (Affine(A=np.eye(3), b=np.zeros(3)),)),
    x0=np.array([0.0, 0.0, 0.0]),
    t=np.linspace(0.0, 5.0, 41),
)
