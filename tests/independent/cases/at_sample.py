"""Contacts exactly at a sample time and at T."""
import numpy as np

from nsbench import Affine, Case, Complementarity


def drift(xp):
    def f(t, x):
        return xp.array([-1.0, -1.0, -0.5])
    return f


CASE = Case(
    name="at_sample",
    problem=Complementarity(drift, (Affine(A=np.eye(3), b=np.zeros(3)),)),
    x0=np.array([1.0, 2.0, 0.125]),
    t=np.linspace(0.0, 2.0, 9),
)
