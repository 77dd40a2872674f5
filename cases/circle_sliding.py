"""Circle: a point drawn onto a circle and carried round it with a weight that moves.

    r' = r (a sin t - s),   phi' = turn(s),   s in Sgn(|x|^2 - 1),   turn(1) = outside,  turn(-1) = inside

in polar coordinates, from (r0, 0). A curved surface, fields that turn at different speeds on its two sides, and a
sliding velocity that follows the weight: s = a sin t holds the point on the circle, |a| < 1. With u the mean of the
two speeds and v half their difference,

    r = r0 exp(a (1 - cos t) -+ t),  phi = (u +- v) t           up to t1, where r = 1 (upper signs: r0 > 1)
    r = 1,  phi = phi(t1) + u (t - t1) + v a (cos t1 - cos t)    from then on.

The integral of the weight is t (r0 > 1) or 0 before t1, then grows by (t - t1) / 2 + a (cos t1 - cos t) / 2.
"""
import numpy as np

from nsbench import Case, Filippov

SUITES = {"standard": [{}], "full": [{"r0": 0.5}]}


def circle(xp):
    def c(t, x):
        return x[0:1] * x[0:1] + x[1:2] * x[1:2] - 1.0
    return c


def arrival(a, r0):
    """The time at which the point meets the circle; the distance in log r falls at a rate of at least 1 - |a|."""
    side = np.sign(np.log(r0))
    rest = lambda t: side * (np.log(r0) + a * (1.0 - np.cos(t))) - t
    t = lo = 0.0
    hi = abs(np.log(r0)) / (1.0 - abs(a)) + 1.0
    for _ in range(200):                          # bisection first keeps Newton's method from leaving
        t = 0.5 * (lo + hi)
        lo, hi = (t, hi) if rest(t) > 0.0 else (lo, t)
        if hi - lo < 1e-3:
            break
    for _ in range(8):
        t -= rest(t) / (side * a * np.sin(t) - 1.0)
    return t


def make(a: float = 0.5, outside: float = 1.5, inside: float = 0.5, r0: float = 1.5) -> Case:
    """a: size of the radial forcing, |a| < 1; outside, inside: turning speeds; r0: start radius, not 1."""
    if not abs(a) < 1.0:
        raise ValueError(f"a is {a}; |a| < 1 keeps the point on the circle")
    if not (r0 > 0.0 and r0 != 1.0):
        raise ValueError(f"r0 is {r0}; a positive radius other than 1 is needed")
    u, v = 0.5 * (outside + inside), 0.5 * (outside - inside)
    side, t1 = np.sign(np.log(r0)), arrival(a, r0)

    def field(xp):
        def f(t, x, s):
            grow, turn = a * xp.sin(t) - s[0], u + v * s[0]
            return xp.array([grow * x[0] - turn * x[1], grow * x[1] + turn * x[0]])
        return f

    def slid(t):
        late = np.maximum(t, t1)
        return late - t1, a * (np.cos(t1) - np.cos(late))

    def exact(t):
        late, swing = slid(t)
        r = np.where(t < t1, r0 * np.exp(a * (1.0 - np.cos(t)) - side * t), 1.0)
        phi = (u + side * v) * np.minimum(t, t1) + u * late + v * swing
        return np.stack([r * np.cos(phi), r * np.sin(phi)], 1)

    def exact_impulse(t):
        late, swing = slid(t)
        return ((side > 0) * np.minimum(t, t1) + 0.5 * late + 0.5 * swing)[:, None]

    return Case(
        name="circle_sliding",
        problem=Filippov.signs(field, circle),
        x0=np.array([r0, 0.0]),
        t=np.linspace(0.0, 4.0, 41),
        exact=exact, exact_impulse=exact_impulse, exact_events=(t1,) if t1 < 4.0 else (),
    )
