"""Two discs and a wall in units of 1e-8: the absolute tolerances of the libraries for quadratic programs were a tenth of it."""
import numpy as np

from nsbench import Affine, Case, Complementarity, Distance


def drift(xp):
    def f(t, x):
        return xp.array([1e-8 * (1.0 - 0.4e8 * x[1]), 0.3e-8 * xp.sin(3.0 * t), -1e-8, 0.4 * x[0]])
    return f


CASE = Case(
    name="scene",
    problem=Complementarity(drift, (Distance(d=1e-8, dim=2), Affine(np.array([[0.0, 1.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0]]),
                                                                    np.array([5e-10, 5e-10])))),
    x0=np.array([-1e-8, 0.0, 1e-8, 0.2e-8]),
    t=np.linspace(0.0, 1.0, 6),
)

BY = ("catching_up[backend=piqp]", "catching_up[backend=osqp]", "catching_up", "event_driven[method=rk45]")
