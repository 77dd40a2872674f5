"""One wall listed three times, scaled."""
import numpy as np

from nsbench import Affine, Case, Complementarity


def drift(xp):
    def f(t, x):
        return xp.array([0.3 * xp.cos(t), xp.sin(t) - 0.4 + 0.1 * x[0]])
    return f


CASE = Case(
    name="dup_rows",
    problem=Complementarity(
        drift, (Affine(A=np.array([[0.5, 1.0], [1.0, 2.0], [0.25, 0.5], [-1.0, 0.0]]), b=np.array([0.3, 0.6, 0.15, 0.6])),)
    ),
    x0=np.array([0.1, 0.2]),
    t=np.linspace(0.0, 14.0, 57),
)
