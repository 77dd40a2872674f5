"""Degenerate corner: a point slides down one wall into a corner where the force presses on the other wall alone.

    x' = -a(t) n1 + lam1 n1 + lam2 n2,   g_i = n_i . x >= 0,   a(t) = 1 + swell sin t,   90 <= psi <= 170

The walls meet at the origin under the angle psi, n1 . n2 = -cos psi. Exact: let s(t) be the integral of a. Free fall
along -n1 up to s = S1 (wall 2), then slide along wall 2 with lam2 = -a cos psi and velocity -sin psi per unit of s
towards the corner, which is reached at s = S2; there the point rests with lam = (a, 0). At psi = 90 the point falls
along wall 2 from the start, and lam2 = 0 throughout.

What it is for: in the corner wall 2 is closed and bears nothing: a biactive constraint. It has neither been left nor
is it pressed on; an active set may hold it or not, and both are right. Calling that a failure is not.
"""
import numpy as np

from nsbench import Affine, Case, Complementarity

S1, S2 = 0.43, 1.27                          # off every sample time
SUITES = {"standard": [{}], "full": [{"psi": 90.0}, {"psi": 120.0, "swell": 0.0}, {"psi": 170.0}]}


def clock(t, swell):
    """s(t) = integral of 1 + swell sin."""
    return t + 2.0 * swell * np.sin(0.5 * t) ** 2


def when(s, swell):
    """The time at which the clock shows s; it is monotone for |swell| < 1."""
    t = s
    for _ in range(60):
        t -= (clock(t, swell) - s) / (1.0 + swell * np.sin(t))
    return t


def make(psi: float = 120.0, swell: float = 0.5) -> Case:
    """psi: angle between the walls in degrees, 90 to 170; swell: how much the force varies in time, in [0, 1)."""
    if not 90.0 <= psi <= 170.0:
        raise ValueError(f"psi is {psi!r}; an angle from 90 to 170 degrees")
    if not 0.0 <= swell < 1.0:
        raise ValueError(f"swell is {swell!r}; at least 0 and below 1")
    angle = np.radians(psi)
    cos, sin = np.sin(np.radians(90.0 - psi)), np.sin(angle)            # cos 90 is exactly zero this way
    normals = np.array([[0.0, 1.0], [sin, -cos]])
    down = np.array([0.0, -1.0])
    slide = down - cos * normals[1]                                     # -n1 without its part across wall 2
    hit = -(S2 - S1) * slide
    knots = np.array([0.0, S1, S2, 100.0])
    corners = np.array([hit - S1 * down, hit, np.zeros(2), np.zeros(2)])
    pressed = np.cumsum([np.zeros(2), np.zeros(2), [0.0, -(S2 - S1) * cos], [100.0 - S2, 0.0]], axis=0)

    def drift(xp):
        def f(t, x):
            return down * (1.0 + swell * xp.sin(t))
        return f

    def polygon(values):
        return lambda t: np.stack([np.interp(clock(t, swell), knots, v) for v in values.T], axis=1)

    events = (when(S1, swell), when(S2, swell))
    return Case(
        name="corner_degenerate",
        problem=Complementarity(drift, (Affine(normals, np.zeros(2)),)),
        x0=corners[0],
        t=np.linspace(0.0, 2.0, 41),
        exact=polygon(corners), exact_impulse=polygon(pressed), exact_events=events if psi > 90.0 else events[1:],
        substeps=max(8, min(64, round(2.0 / sin**2))),     # a sweep takes 1 / sin^2 steps to see through the corner
        also=("pbd[order=reverse]",), tags=("biactive",) if swell else ("biactive", "constant_force"),
    )
