"""Stiff contact: a strong spring drags a point along cos t, into the floor and off it again.

    x' = -K (x - cos t) - sin t + lam,   0 <= x _|_ lam >= 0,   x(0) = 1

Exact: x = cos t, which solves the free equation for every K, up to t1 = pi/2; then x = 0 and lam = sin t - K cos t,
which starts at 1, grows to about K and vanishes at t2 = 3 pi/2 - arctan(1/K); then the point follows the spring,
x = cos t + e^{-K (t - t2)} / sqrt(1 + K^2). The impulse on the floor is K (1 - sin t) - cos t.

What it is for: explicit methods need h < 2/K, on the floor and off it; lam is O(K) and so is its error, while the state
is as easy as ever. The ladder of steps starts within the limit of stability.
"""
import numpy as np

from nsbench import Affine, Case, Complementarity

SUITES = {"standard": [{}], "full": [{"K": 1e4}]}
T, SAMPLES = 6.0, 40


def make(K: float = 100.0) -> Case:
    """K: stiffness of the spring, positive."""
    if not 0.0 < K <= 1e8:
        raise ValueError(f"K is {K!r}; a positive number up to 1e8")
    t1, t2 = np.pi / 2, 1.5 * np.pi - np.arctan(1.0 / K)
    left = 1.0 / np.hypot(1.0, K)                       # -cos(t2)

    def drift(xp):
        def f(t, x):
            return -K * (x - xp.cos(t)) - xp.sin(t)
        return f

    def exact(t):
        after = np.cos(t) + left * np.exp(-K * np.maximum(t - t2, 0.0))
        return np.where(t < t1, np.cos(t), np.where(t < t2, 0.0, after))[:, None]

    def exact_impulse(t):
        s = np.clip(t, t1, t2)
        return (2.0 * K * np.sin(0.5 * (s - t1)) ** 2 + np.sin(s - t1))[:, None]      # of K (1 - sin s) - cos s

    return Case(
        name="stiff_contact",
        problem=Complementarity(drift, (Affine(np.eye(1), np.zeros(1)),)),
        x0=np.ones(1),
        t=np.linspace(0.0, T, SAMPLES + 1),
        exact=exact, exact_impulse=exact_impulse, exact_events=(t1, t2),
        substeps=max(8, int(np.ceil(T / SAMPLES * K))),     # h <= 1/K
        tags=("stiff",),
    )
