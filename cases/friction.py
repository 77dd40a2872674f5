"""Friction: a mass on a spring that dry friction stops within a finite time.

    x' = v,   v' = -x - mu s,   s in Sgn(v),   (x, v)(0) = (x0, 0)

The swing loses 2 mu of its amplitude in each half turn and sticks at the first turn inside |x| <= mu, an interval of
equilibria: from x0 = 1 with mu = 0.3 at t = 2 pi in x = -0.2, with s = 2/3. The start itself lies on the surface v = 0.
Exact: in the half turn from t = k pi, at x_k, the motion is x = m + (x_k - m) cos(t - k pi) about m = mu sgn(x_k);
then x_{k+1} = 2 m - x_k. At rest s = -x / mu.
"""
import numpy as np

from nsbench import Case, Filippov

SUITES = {"standard": [{}], "full": [{"mu": 0.05}]}


def speed(xp):
    def c(t, x):
        return x[1:2]
    return c


def make(mu: float = 0.3, x0: float = 1.0) -> Case:
    """mu: friction over stiffness, positive; x0: where the mass is let go."""
    if not mu > 0.0:
        raise ValueError(f"mu is {mu}; a positive number is needed")
    turns = [x0]
    while abs(turns[-1]) > mu:
        turns.append(2.0 * np.copysign(mu, turns[-1]) - turns[-1])
    turns, last = np.array(turns), len(turns) - 1
    T = 8.0 if mu >= 0.2 else 40.0

    def field(xp):
        def f(t, x, s):
            return xp.array([x[1], -x[0] - mu * s[0]])
        return f

    def exact(t):
        k = np.minimum((t / np.pi).astype(int), last)
        mid, u = np.copysign(mu, turns[k]), t - np.pi * k
        swing = k < last
        return np.stack([np.where(swing, mid + (turns[k] - mid) * np.cos(u), turns[k]),
                         np.where(swing, (mid - turns[k]) * np.sin(u), 0.0)], 1)

    def exact_impulse(t):
        """theta is 1 in the half turns that go up, 0 in those that go down, (1 + s) / 2 at rest."""
        k = np.minimum((t / np.pi).astype(int), last)
        up = turns < 0.0
        before = np.pi * np.concatenate(([0.0], np.cumsum(up[:-1])))
        rate = np.where(k < last, up[k], 0.5 - 0.5 * turns[k] / mu)
        return (before[k] + rate * (t - np.pi * k))[:, None]

    return Case(
        name="friction",
        problem=Filippov.signs(field, speed),
        x0=np.array([x0, 0.0]),
        t=np.linspace(0.0, T, 41),
        exact=exact, exact_impulse=exact_impulse, exact_events=tuple(np.pi * k for k in range(1, last + 1) if np.pi * k < T),
    )
