"""The gradient has length 1e3, then 1e-3."""
import numpy as np

from nsbench import Affine, Case, Complementarity


def drift(xp):
    def f(t, x):
        return xp.array([-xp.cos(t), -xp.sin(t)])
    return f


CASE = Case(
    name="offset_scaled",
    problem=Complementarity(drift, (Affine(A=np.array([[1e3, 0.0], [0.0, 1e-3]]), b=np.array([0.0, 5e-4])),)),
    x0=np.array([0.5, 0.2]),
    t=np.linspace(0.0, 8.0, 41),
)
