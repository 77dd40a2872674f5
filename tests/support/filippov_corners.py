"""Filippov systems with several surfaces and closed forms; the same returns as in
filippov_systems."""

import numpy as np
from filippov_factories import constant, drift, stack, states, still
from filippov_friction import swing

from nsbench import Filippov


def corner_met_at_once():
    """Two relays that reach their common point in the same instant."""
    u = lambda t: np.maximum(t - 1, 0)
    return (
        Filippov.relay(still, -np.eye(2), states),
        (1.0, -1.0),
        3.0,
        lambda t: stack(np.maximum(1 - t, 0), np.minimum(t - 1, 0)),
        lambda t: stack(np.minimum(t, 1) + 0.5 * u(t), 0.5 * u(t)),
        [(1, "enter", 0), (1, "enter", 1)],
    )


def corner_met_almost_at_once():
    """The same with 1e-10 between the two."""
    b = 1 + 1e-10
    return (
        Filippov.relay(still, -np.eye(2), states),
        (1.0, -b),
        3.0,
        lambda t: stack(np.maximum(1 - t, 0), np.minimum(t - b, 0)),
        lambda t: stack(np.minimum(t, 1) + 0.5 * np.maximum(t - 1, 0), 0.5 * np.maximum(t - b, 0)),
        [(1, "enter", 0), (b, "enter", 1)],
    )


def corner_crossed():
    """Four constant fields that all lead through the corner."""
    modes = {(1, 1): (-1, -1), (1, -1): (-2, -1), (-1, 1): (-1, -3), (-1, -1): (-2, -3)}
    problem = Filippov({k: constant(*map(float, v)) for k, v in modes.items()}, states)
    x = lambda t: stack(
        1 - np.minimum(t, 1) - 2 * np.maximum(t - 1, 0),
        1 - np.minimum(t, 1) - 3 * np.maximum(t - 1, 0),
    )
    return (
        problem,
        (1.0, 1.0),
        3.0,
        x,
        lambda t: stack(np.minimum(t, 1), np.minimum(t, 1)),
        [(1, "cross", 0), (1, "cross", 1)],
    )


def corner_crossed_and_held():
    """One surface is crossed and the other holds in the same instant."""
    problem = Filippov.signs(
        drift(lambda xp, t, x, s: xp.array([0.5 * s[0] - 1.5, 0.2 * s[0] - s[1]])), states
    )
    u = lambda t: np.maximum(t - 1, 0)
    return (
        problem,
        (1.0, 0.8),
        3.0,
        lambda t: stack(np.where(t < 1, 1 - t, -2 * u(t)), np.maximum(0.8 - 0.8 * t, 0)),
        lambda t: stack(np.minimum(t, 1), np.minimum(t, 1) + 0.4 * u(t)),
        [(1, "cross", 0), (1, "enter", 1)],
    )


def corner_left():
    """Both coupled relays hold from the start; the load on the first outgrows it."""
    G = np.array([[1.0, 0.4], [0.4, 1.0]])
    end = 0.92
    problem = Filippov.relay(drift(lambda xp, t, x: xp.array([t, 0.2 + 0 * t])), -G, states)

    def w(t):
        u = np.minimum(t, end)
        late = np.maximum(t - end, 0)
        return stack(
            0.5 * u + 0.5 * (0.5 * u * u - 0.08 * u) / 0.84 + late,
            0.5 * u + 0.5 * (0.2 * u - 0.2 * u * u) / 0.84 + 0.4 * late,
        )

    return (
        problem,
        (0.0, 0.0),
        3.0,
        lambda t: stack(np.where(t < end, 0, (t - end) ** 2 / 2), 0),
        w,
        [(end, "exit", 0)],
    )


def coupled_inputs():
    """Two inputs that act on both states: one surface is reached and slid on, then the corner."""
    problem = Filippov.relay(still, -np.array([[1.0, 0.5], [-0.3, 1.0]]), states)
    t1 = 2 / 7
    t2 = t1 + (4 / 7) / 1.15

    def x(t):
        return stack(
            np.where(t < t1, 1 - 1.5 * t, np.where(t < t2, 4 / 7 - 1.15 * (t - t1), 0)),
            np.maximum(0.2 - 0.7 * t, 0),
        )

    def w(t):
        u = np.minimum(t, t1)
        v = np.clip(t, t1, t2) - t1
        late = np.maximum(t - t2, 0)
        return stack(u + v + 0.5 * late, u + 0.65 * v + 0.5 * late)

    return problem, (1.0, 0.2), 3.0, x, w, [(t1, "enter", 1), (t2, "enter", 0)]


def three_held():
    """Three coupled relays hold a moving load."""
    G = np.array([[2.0, 0.3, 0.1], [0.2, 1.5, 0.3], [0.1, 0.2, 1.0]])
    load = drift(lambda xp, t, x: xp.array([0.5 * xp.sin(t), 0.3 * xp.cos(t), 0.2 * xp.sin(2 * t)]))
    L = lambda t: np.stack([0.5 * (1 - np.cos(t)), 0.3 * np.sin(t), 0.1 * (1 - np.cos(2 * t))])
    return (
        Filippov.relay(load, -G, states),
        (0.0, 0.0, 0.0),
        5.0,
        lambda t: np.zeros((len(t), 3)),
        lambda t: 0.5 * t[:, None] + 0.5 * np.linalg.solve(G, L(t)).T,
        [],
    )


def three_mixed():
    """Three stick-slip motions seen through mixed coordinates: the surfaces are oblique planes."""
    A = np.array([1.3, 2.0, 1.1])
    T = 9.0
    M = np.array([[1.0, 2.0, 0.0], [0.0, 1.0, 1.0], [1.0, 0.0, 1.0]])
    back = np.linalg.inv(M)
    parts = [swing(a, x0, T) for a, x0 in zip(A, (0.4, -0.6, 0.0), strict=True)]
    problem = Filippov.relay(
        drift(lambda xp, t, x: xp.asarray(back) @ (xp.asarray(A) * xp.sin(t))),
        -back,
        drift(lambda xp, t, x: xp.asarray(M) @ x),
    )
    events = sorted((t, kind, i) for i, (_, _, e) in enumerate(parts) for t, kind, _ in e)
    return (
        problem,
        back @ np.array([0.4, -0.6, 0.0]),
        T,
        lambda t: np.stack([p[0](t) for p in parts], 1) @ back.T,
        lambda t: np.stack([p[1](t) for p in parts], 1),
        events,
    )


def same_surface_twice():
    """Two relays on one surface share a load that a third of their strength holds; only their sum
    counts."""
    problem = Filippov.relay(
        drift(lambda xp, t, x: 0.5 * xp.sin(t) + 0 * x),
        np.array([[-1.0, -0.5]]),
        drift(lambda xp, t, x: xp.concatenate((x, x))),
    )
    s = lambda t: 0.5 * (1 - np.cos(t))
    return (
        problem,
        (0.0,),
        5.0,
        lambda t: np.zeros((len(t), 1)),
        lambda t: 0.5 * t[:, None] + 0.5 * s(t)[:, None] * np.array([1.0, 0.5]) / 1.25,
        [],
    )


SEVERAL = {
    f.__name__: f
    for f in (
        corner_met_at_once,
        corner_met_almost_at_once,
        corner_crossed,
        corner_crossed_and_held,
        corner_left,
        coupled_inputs,
        three_held,
        three_mixed,
        same_surface_twice,
    )
}
