"""Wedge: a point is pushed onto one wall of a wedge, slides down along it and rests in the corner.

    x' = a(t) u + lam1 n1 + lam2 n2,   g_i = n_i . x >= 0,   a(t) = 1 + swell sin t

The walls meet at the origin under the angle psi, n1 . n2 = -cos psi. The unit force is u = -(l1 n1 + l2 n2) with
l2/l1 = 1 - 0.3 (1 - cos psi): it presses on both walls once the point is in the corner, and on its way the point
meets wall 1 first.

Exact: let s(t) be the integral of a. Free fall x0 + s u up to s = S1 (wall 1), then slide with velocity
u + m n1 per unit of s, m = -u . n1 = l1 - l2 cos psi, up to s = S2 (corner), then rest with lam = a (l1, l2): what
does not depend on a is a fixed polygon run through with the clock s, and so are the impulses. x0 is chosen so
that S1 and S2 are the same for every angle.

What it is for: the chain reaction of two projections. A sweep leaves wall 1 violated by h lam2 cos psi at rest when
psi < 90 degrees and by nothing beyond; the corner error is about h lam2 |cot psi|. With swell = 0 a method that
solves both walls at once is exact at grid times (constant force), only the sweep shows an order; swell > 0 gives
every method one.
"""
import numpy as np

from nsbench import Affine, Case, Complementarity

S1, S2 = 0.43, 1.27                          # off every sample time, so that both walls are met inside steps
SUITES = {"smoke": [{"psi": 60.0}], "standard": [{"psi": 60.0}, {"psi": 120.0}],
          "full": [{"psi": 10.0}, {"psi": 30.0}, {"psi": 60.0, "swell": 0.5}, {"psi": 90.0, "swell": 0.5}, {"psi": 150.0},
                   {"psi": 170.0}]}


def clock(t, swell):
    """s(t) = integral of 1 + swell sin."""
    return t + swell * (1.0 - np.cos(t))


def when(s, swell):
    """The time at which the clock shows s; it is monotone for |swell| < 1."""
    t = s
    for _ in range(60):
        t -= (clock(t, swell) - s) / (1.0 + swell * np.sin(t))
    return t


def make(psi: float = 60.0, swell: float = 0.0) -> Case:
    """psi: angle between the walls in degrees, 10 to 170; swell: how much the force varies in time, in [0, 1)."""
    if not 10.0 <= psi <= 170.0:
        raise ValueError(f"psi is {psi!r}; an angle from 10 to 170 degrees")
    if not 0.0 <= swell < 1.0:
        raise ValueError(f"swell is {swell!r}; at least 0 and below 1")
    c, half = np.cos(np.radians(psi)), np.radians(psi) / 2
    normals = np.array([[np.cos(half), np.sin(half)], [-np.cos(half), np.sin(half)]])
    loads = np.array([1.0, 1.0 - 0.3 * (1.0 - c)])
    loads /= np.linalg.norm(loads @ normals)
    push = -loads @ normals
    slide = push - (push @ normals[0]) * normals[0]
    hit = -(S2 - S1) * slide
    knots = np.array([0.0, S1, S2, 10.0])
    corners = np.array([hit - S1 * push, hit, np.zeros(2), np.zeros(2)])
    pressed = np.cumsum([np.zeros(2), np.zeros(2), [-(S2 - S1) * (push @ normals[0]), 0.0],
                         (10.0 - S2) * loads], axis=0)

    def drift(xp):
        def f(t, x):
            return push * (1.0 + swell * xp.sin(t))
        return f

    def polygon(values):
        return lambda t: np.stack([np.interp(clock(t, swell), knots, v) for v in values.T], axis=1)

    return Case(
        name="wedge",
        problem=Complementarity(drift, (Affine(normals, np.zeros(2)),)),
        x0=corners[0],
        t=np.linspace(0.0, 2.0, 41),
        exact=polygon(corners), exact_impulse=polygon(pressed), exact_events=(when(S1, swell), when(S2, swell)),
        substeps=8, tags=() if swell else ("constant_force",),
    )
