"""Dragged disc: a point inside a disc of radius 1 whose centre walks away, and then drags it along the tractrix.

    x' = lam grad g,   g = 1 - |x - c(t)| >= 0,   c = (t, 0),   x(0) = (0, 0.6)

Exact: the point lies still until the rim reaches it at t1 = 0.8, where x - c = (cos p, sin p) with sin p = 0.6. Then
p' = sin p, so tan(p/2) grows like e^t, and lam = -cos p, with the impulse ln(sin p1 / sin p). What it is for: a
constraint that is curved and moves, without any drift; everything comes from dg/dt.
"""
import numpy as np

from nsbench import Case, Complementarity, Distance

HEIGHT = 0.6
T1 = 0.8                             # sqrt(1 - HEIGHT^2)
U1 = (1.0 + T1) / HEIGHT             # tan(p/2) where the rim reaches the point


def drift(xp):
    def f(t, x):
        return 0.0 * x
    return f


def centre(xp):
    along = np.array([[1.0, 0.0]])
    def c(t):
        return t * along
    return c


def half_angle(t):
    """u = tan(p/2), which grows like e^t."""
    return U1 * np.exp(np.maximum(t - T1, 0.0))


def exact(t):
    u = half_angle(t)
    dragged = np.stack((t - (u - 1.0) * (u + 1.0) / (1.0 + u * u), 2.0 * u / (1.0 + u * u)), axis=1)
    return np.where((t < T1)[:, None], [0.0, HEIGHT], dragged)


def exact_impulse(t):
    u = half_angle(t)
    return np.where(t < T1, 0.0, np.log(0.5 * HEIGHT * (1.0 + u * u) / u))[:, None]


CASE = Case(
    name="dragged_disc",
    problem=Complementarity(drift, (Distance(d=1.0, sign=-1, pairs=[[0, 0]], anchors=centre),)),
    x0=np.array([0.0, HEIGHT]),
    t=np.linspace(0.0, 4.0, 41),
    exact=exact, exact_impulse=exact_impulse, exact_events=(T1,), contacts=((0, 0, 0),), substeps=16,
)
SUITES = {"full": [{}]}
