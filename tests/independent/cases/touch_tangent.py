"""y = (t - 1)^2 touches the floor with lambda = 0."""
import numpy as np

from nsbench import Affine, Case, Complementarity


def drift(xp):
    def f(t, x):
        return xp.array([2.0 * (t - 1.0)])
    return f


CASE = Case(
    name="touch_tangent",
    problem=Complementarity(drift, (Affine(A=np.eye(1), b=np.zeros(1)),)),
    x0=np.array([1.0]),
    t=np.linspace(0.0, 3.0, 31),
)
