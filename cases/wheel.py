"""Wheel: a point inside a disc is blown against the rim and carried round by a turning drift.

    x' = (1, 0) + w J x + lam grad g,   g = 1 - |x| >= 0,   x(0) = 0,   0 < w < 2

Exact, with z = x1 + i x2: free, z = (e^{iwt} - 1) / (iw), the rim is reached at t1 = 2 asin(w/2) / w at the angle
p1 = asin(w/2). On the rim p' = w - sin p and lam = cos p, so the impulse is ln((w - sin p1) / (w - sin p)).
Adler's equation is solved through u = tan(p/2), u' = w/2 (u - u+)(u - u-). For w < 1 the point comes to rest at
sin p = w. For w > 1 it goes on, is released at the top p = pi/2 (lam = 0), and then circles freely about i/w with
radius 1 - 1/w, touching the rim tangentially at the top once per turn.
"""
import numpy as np

from nsbench import Case, Complementarity, Distance

SUITES = {"full": [{"w": 0.5}, {"w": 1.5}]}
EAST, TURN = np.array([1.0, 0.0]), np.array([-1.0, 1.0])


def make(w: float = 0.5) -> Case:
    """w: angular velocity of the drift, in (0, 2) and not 1."""
    if not 0.0 < w < 2.0 or w == 1.0:
        raise ValueError(f"w is {w!r}; a number in (0, 2) other than 1")
    p1 = np.arcsin(w / 2)
    t1, u1 = 2 * p1 / w, np.tan(p1 / 2)
    s = np.sqrt(abs(1.0 - w * w))
    # w > 1: u = (1 + s tan(s (t - t1) / 2 + shift)) / w reaches u = 1, the top
    shift = np.arctan((w * u1 - 1.0) / s)
    t2 = t1 + 2.0 / s * (np.arctan((w - 1.0) / s) - shift) if w > 1 else np.inf

    high, low = (1.0 + s) / w, (1.0 - s) / w            # u+ and u-, for w < 1

    def quotient(t):
        """(u - u-) / (u - u+) on the rim."""
        return (u1 - low) / (u1 - high) * np.exp(-s * (np.maximum(t, t1) - t1))

    def half_angle(t):
        """u = tan(p/2) on the rim, for t in [t1, t2]."""
        if w > 1:
            return (1.0 + s * np.tan(0.5 * s * (np.clip(t, t1, t2) - t1) + shift)) / w
        q = quotient(t)
        return (low - q * high) / (1.0 - q)

    def drift(xp):
        def f(t, x):
            return EAST + w * TURN * x[::-1]
        return f

    def exact(t):
        free = (np.exp(1j * w * t) - 1.0) / (1j * w)
        rim = np.exp(2j * np.arctan(half_angle(t)))
        z = np.where(t < t1, free, rim)
        if w > 1:
            z = np.where(t < t2, z, 1j / w + 1j * (1.0 - 1.0 / w) * np.exp(1j * w * (t - t2)))
        return np.stack((z.real, z.imag), axis=1)

    def exact_impulse(t):
        u = half_angle(t)
        if w > 1:
            left = w - 2.0 * u / (1.0 + u * u)
        else:                               # w - sin p = w (u - u+) (u - u-) / (1 + u^2), which tends to zero
            q = quotient(t)
            left = w * q * (2.0 * s / w / (1.0 - q)) ** 2 / (1.0 + u * u)
        return np.where(t < t1, 0.0, np.log((w / 2) / left))[:, None]

    # w > 1: long enough for one touch after the release of w = 1.5
    t = np.linspace(0.0, 5.0, 41) if w < 1 else np.linspace(0.0, 8.0, 65)
    return Case(
        name="wheel",
        problem=Complementarity(drift, (Distance(d=1.0, sign=-1, pairs=[[0, 0]], anchors=np.zeros((1, 2))),)),
        x0=np.zeros(2),
        t=t,
        exact=exact, exact_impulse=exact_impulse, exact_events=(t1, t2) if t2 < t[-1] else (t1,),
        contacts=((0, 0, 0),), substeps=16,
    )
