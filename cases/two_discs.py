"""Two discs: drawn to the origin, turned by w, they meet and go on as one.

    x_i' = -x_i + w J x_i + lam (x_i - x_j) / |x_i - x_j|,   g = |x_1 - x_2| - 2 >= 0,   J = [[0, -1], [1, 0]]

Exact, in complex numbers with r = -1 + i w: the mean is m = m0 e^{rt} at all times; the difference is d = d0 e^{rt}
up to t1 = ln(|d0| / 2) and then keeps its length 2 and turns, d = 2 d0/|d0| e^{iwt}. Along d the pull -d is
balanced by 2 lam, so lam = 1. The mean starts off the origin: states with the mean at rest hide errors.
"""
import numpy as np

from nsbench import Case, Complementarity, Distance

X0 = np.array([2.0, 0.6, -1.6, -0.9])
TURN = np.array([-1.0, 1.0, -1.0, 1.0])
SUITES = {"standard": [{}, {"w": 1.0}]}


def make(w: float = 0.0) -> Case:
    """w: angular velocity of the drift."""
    z0 = X0[0::2] + 1j * X0[1::2]
    mean, apart = z0.sum() / 2, z0[0] - z0[1]
    meet = np.log(abs(apart) / 2)

    def drift(xp):
        def f(t, x):
            return -x + w * TURN * x.reshape((-1, 2))[:, ::-1].flatten()
        return f

    def exact(t):
        m = mean * np.exp((-1 + 1j * w) * t)
        d = apart * np.exp(-np.minimum(t, meet) + 1j * w * t)
        return np.stack(((m + d / 2).real, (m + d / 2).imag, (m - d / 2).real, (m - d / 2).imag), axis=1)

    def exact_impulse(t):
        return np.maximum(t - meet, 0.0)[:, None]

    return Case(
        name="two_discs",
        problem=Complementarity(drift, (Distance(d=2.0),)),
        x0=X0,
        t=np.linspace(0.0, 2.0, 41),
        exact=exact, exact_impulse=exact_impulse, exact_events=(meet,), contacts=((0, 0, 1),),
        substeps=8, tags=("seed",), radius=1.0,
    )
