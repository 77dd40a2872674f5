"""Moving floor: a point sinks onto a floor that goes up and down, a sin t.

    x' = -b + lam,   g = x - a sin t >= 0,   x(0) = 1/2

Exact: the point sinks, x = 1/2 - b t, until it meets the floor; then x = a sin t and lam = b + a cos t as long as
that is not negative. For a < b it stays for ever. For a > b the floor falls away faster than the point sinks at
t = arccos(-b/a) (+ 2 pi k); the point flies, x = a sin t_k - b (t - t_k), until the floor comes up again. The times of
landing are roots, found by bisection to rounding. What it is for: methods that forget dg/dt rest in the wrong
place. The drift is constant, so projecting methods err by O(h^2) only, in the steps with an event.
"""
import numpy as np

from nsbench import Affine, Case, Complementarity

SUITES = {"full": [{}, {"a": 0.5}]}
START, T = 0.5, 8.0


def root(f, low, high):
    """The zero of f between low, where it is positive, and high, where it is not."""
    for _ in range(200):
        mid = 0.5 * (low + high)
        low, high = (mid, high) if f(mid) > 0 else (low, mid)
    return high


def flights(a, b):
    """List of (height and time at which a flight starts, time at which it ends), up to T."""
    out, height, t = [], START, 0.0
    while t < T:
        gap = lambda s, height=height, t=t: height - b * (s - t) - a * np.sin(s)
        fine = np.linspace(t, t + (abs(height) + a + 1.0) / b + 2 * np.pi, 20001)[1:]
        first = int(np.argmax(gap(fine) <= 0))
        land = root(gap, fine[max(first - 1, 0)], fine[first])
        out.append((height, t, land))
        if a <= b:
            break
        leave = np.arccos(-b / a)
        if b + a * np.cos(land) < 0:
            raise ValueError(f"a={a}, b={b}: the point lands where the floor falls faster than it sinks")
        t = leave + 2 * np.pi * np.ceil((land - leave) / (2 * np.pi))
        height = a * np.sin(t)
    return out


def make(a: float = 1.5, b: float = 1.0) -> Case:
    """a: amplitude of the floor; b: speed at which the point sinks; both positive."""
    if not (a > 0 and b > 0):
        raise ValueError(f"a is {a!r}, b is {b!r}; both must be positive")
    air = flights(a, b)

    def drift(xp):
        def f(t, x):
            return -b * xp.ones_like(x)
        return f

    def floor(xp):
        def level(t):
            return -a * xp.sin(t) * xp.ones(1)
        return level

    def exact(t):
        x = a * np.sin(t)
        for height, leave, land in air:
            x = np.where((t >= leave) & (t < land), height - b * (t - leave), x)
        return x[:, None]

    def exact_impulse(t):
        return (exact(t)[:, 0] - START + b * t)[:, None]         # lam = x' + b

    events = tuple(e for _, leave, land in air for e in (leave, land) if 0.0 < e < T)
    return Case(
        name="moving_floor",
        problem=Complementarity(drift, (Affine(np.eye(1), floor),)),
        x0=np.array([START]),
        t=np.linspace(0.0, T, 41),
        exact=exact, exact_impulse=exact_impulse, exact_events=events, substeps=16,
    )
