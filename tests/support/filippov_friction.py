"""Oscillators with dry friction and closed forms; the same returns as in filippov_systems."""

import numpy as np
from filippov_factories import drift, root, stack, states

from nsbench import Filippov


def belt_that_is_touched():
    """Dry friction on a belt: sticks up to x = mu, then swings about mu and touches the belt's
    speed in each turn."""
    mu = 0.3
    v = 0.5
    problem = Filippov.signs(
        drift(lambda xp, t, x, s: xp.array([x[1], -x[0] - mu * s[0]])),
        drift(lambda xp, t, x: x[1:2] - v),
    )
    end = (mu + 0.2) / v

    def x(t):
        u = np.maximum(t - end, 0.0)
        return stack(np.where(t < end, v * t - 0.2, mu + v * np.sin(u)), v * np.cos(u))

    def w(t):
        u = np.minimum(t, end)
        return (0.5 * u - 0.5 / mu * (0.5 * v * u * u - 0.2 * u))[:, None]

    return problem, (-0.2, v), 20.0, x, w, [(end, "exit", 0)]


def belt_crossed_then_caught():
    """Slower than the belt, faster, sticking, slower: arcs of three circles and a line."""
    mu = 0.3
    v = 0.2
    x0 = 1.5
    problem = Filippov.signs(
        drift(lambda xp, t, x, s: xp.array([x[1], -x[0] - mu * s[0]])),
        drift(lambda xp, t, x: x[1:2] - v),
    )
    A = x0 - mu
    t1 = np.pi + np.arcsin(v / A)
    x1 = mu - np.sqrt(A * A - v * v)
    B = np.hypot(x1 + mu, v)
    a = np.arctan2(-v, x1 + mu)
    u = -np.arcsin(v / B) - a
    t2 = t1 + u
    x2 = -mu + B * np.cos(u + a)
    t3 = t2 + (mu - x2) / v

    def x(t):
        late = t - t3
        pieces = [t < t1, t < t2, t < t3]
        return stack(
            np.select(
                pieces,
                [mu + A * np.cos(t), -mu + B * np.cos(t - t1 + a), x2 + v * (t - t2)],
                mu + v * np.sin(late),
            ),
            np.select(pieces, [-A * np.sin(t), -B * np.sin(t - t1 + a), v], v * np.cos(late)),
        )

    def w(t):
        u = np.clip(t, t2, t3) - t2
        return (np.clip(t, t1, t2) - t1 + 0.5 * u - 0.5 / mu * (x2 * u + 0.5 * v * u * u))[:, None]

    return problem, (x0, 0.0), 16.0, x, w, [(t1, "cross", 0), (t2, "enter", 0), (t3, "exit", 0)]


def swing(a, x0, T):
    """x' = a sin t - s, s in Sgn(x), arc by arc: x(t) (k,), integral of theta (k,), events."""
    F = lambda t: -a * np.cos(t)
    t = 0.0
    x = x0
    mode = np.sign(x0)
    arcs = []
    events = []
    while t < T:
        arcs.append((t, x, mode))
        if mode:
            f = lambda u, t=t, x=x, m=mode: m * (x + F(u) - F(t)) - (u - t)
            grid = np.linspace(t + 1e-3, t + 20.0, 100_001)
            k = int(np.argmax(f(grid) < 0.0))
            t = root(f, grid[k - 1], grid[k])
            x = 0.0
            mode = 0.0 if abs(a * np.sin(t)) < 1.0 else np.sign(np.sin(t))
            events.append((t, "cross" if mode else "enter", 0))
        else:
            p = np.arcsin(1.0 / a)
            t = min(
                c
                for k in range(20)
                for c in (p + 2 * np.pi * k, p + np.pi * (2 * k + 1))
                if c > t + 1e-9
            )
            mode = np.sign(np.sin(t))
            events.append((t, "exit", 0))
    t0, X, M = (np.array(v) for v in zip(*arcs, strict=True))

    def weight(k, t):
        free = 0.5 * (1.0 + M[k]) * (t - t0[k])
        return np.where(M[k] != 0, free, 0.5 * (t - t0[k] + F(t) - F(t0[k])))

    before = np.concatenate(([0.0], np.cumsum(weight(np.arange(len(arcs) - 1), t0[1:]))))
    at = lambda t: np.searchsorted(t0, t, side="right") - 1
    x = lambda t: np.where(
        M[at(t)] != 0, X[at(t)] + F(t) - F(t0[at(t)]) - M[at(t)] * (t - t0[at(t)]), 0.0
    )
    return x, lambda t: before[at(t)] + weight(at(t), t), [e for e in events if e[0] < T]


def forced(kind, a, x0=0.7, T=25.0):
    """x' = a sin t - s by one of the three constructors: sticks, slips, crosses."""
    push = drift(lambda xp, t, x: a * xp.sin(t) + 0 * x)
    problem = {
        "relay": lambda: Filippov.relay(push, np.array([[-1.0]]), states),
        "signs": lambda: Filippov.signs(
            drift(lambda xp, t, x, s: a * xp.sin(t) - s[0] + 0 * x), states
        ),
        "modes": lambda: Filippov(
            {
                (1,): drift(lambda xp, t, x: a * xp.sin(t) - 1 + 0 * x),
                (-1,): drift(lambda xp, t, x: a * xp.sin(t) + 1 + 0 * x),
            },
            states,
        ),
    }[kind]()
    x, w, events = swing(a, x0, T)
    return problem, (x0,), T, lambda t: x(t)[:, None], lambda t: w(t)[:, None], events
