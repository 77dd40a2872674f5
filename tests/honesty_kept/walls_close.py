"""A wall closes on two discs in a row against another wall: where no room is left, sweeps went on and said ok."""
import numpy as np

from nsbench import Affine, Case, Complementarity, Distance


def drift(xp):
    def f(t, x):
        return xp.array([1.0, -1.0])
    return f


def b(xp):
    def f(t):
        return xp.array([1.0, 1.5 - t])
    return f


CASE = Case(
    name="scene",
    problem=Complementarity(drift, (Distance(d=1.0, dim=1), Affine(np.array([[1.0, 0.0], [0.0, -1.0]]), b))),
    x0=np.array([-0.8, 0.9]),
    t=np.linspace(0.0, 2.0, 6),
)

BY = ("pbd", "pbd[order=reverse]", "richardson", "catching_up")
