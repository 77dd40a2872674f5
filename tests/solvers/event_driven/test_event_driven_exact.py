"""Scenes outside the catalogue with closed forms: states to 1e-12, events and impulses to 1e-11.

Every closed form is first held against its own equation, x' = f + sum lam grad g, by differences.
"""

from dataclasses import dataclass

import mpmath
import numpy as np
import pytest

from nsbench import Affine, Case, Complementarity, Distance, Smooth
from nsbench.dynamics.contacts.constraint_set import ConstraintSet
from nsbench.solvers import solve

A0 = 0.3  # angle off the top where the falling point lands


@dataclass(frozen=True)
class Known:
    """x(t) and impulse(t), columns by sorted contact id; events: (time, kind)."""

    case: Case
    x: object
    impulse: object
    events: tuple


def known(drift, constraints, x0, T, x, impulse, *events, k=17):
    case = Case(
        name="known",
        problem=Complementarity(drift, constraints),
        x0=np.array(x0, float),
        t=np.linspace(0.0, T, k),
    )
    return Known(case, x, impulse, events)


def down(xp):
    return lambda t, x: xp.stack((0.0 * x[0], -1.0 + 0.0 * x[1]))


def roll(constraint):
    """Falls on the unit disc at angle A0 and slides off: a' = sin a, lam = cos a, leaves at the
    side."""
    t1 = 1.5 - np.cos(A0)
    t2 = t1 - np.log(np.tan(A0 / 2))

    def x(t):
        a = 2 * np.arctan(np.tan(A0 / 2) * np.exp(t - t1))
        return (
            [np.sin(A0), 1.5 - t] if t < t1 else [np.sin(a), np.cos(a)] if t < t2 else [1.0, t2 - t]
        )

    def impulse(t):  # cos a = tanh(t2 - t)
        return [np.log(np.cosh(t2 - t1)) - np.log(np.cosh(t2 - np.clip(t, t1, t2)))]

    return known(
        down, (constraint,), [np.sin(A0), 1.5], 4.0, x, impulse, (t1, "contact"), (t2, "release")
    )


def ellipse():
    """Over x^2/4 + y^2 = 1 at (2 sin a, cos a): a' = sin a / (4 - 3 sin^2 a), so t = 4 log tan(a/2)
    + 3 cos a;
    lam dt = 2 cot a da."""
    clock = lambda a: 4 * mpmath.log(mpmath.tan(a / 2)) + 3 * mpmath.cos(a)
    t1 = 1.5 - np.cos(A0)
    t2 = float(t1 - clock(mpmath.mpf(A0)))

    def angle(t):
        goal = mpmath.mpf(t) - t1 + clock(mpmath.mpf(A0))
        return float(
            mpmath.findroot(
                lambda a: clock(a) - goal, (A0, np.pi / 2), solver="anderson", tol=1e-30
            )
        )

    def x(t):
        return (
            [2 * np.sin(A0), 1.5 - t]
            if t < t1
            else [2.0, t2 - t]
            if t >= t2
            else [2 * np.sin(angle(t)), np.cos(angle(t))]
        )

    def impulse(t):
        return [
            0.0
            if t < t1
            else -2 * np.log(np.sin(A0))
            if t >= t2
            else 2 * np.log(np.sin(angle(t)) / np.sin(A0))
        ]

    g = Smooth(lambda xp: lambda t, x: (x[0] ** 2 / 4 + x[1] ** 2 - 1.0).reshape((1,)))
    return known(
        down, (g,), [2 * np.sin(A0), 1.5], 7.0, x, impulse, (t1, "contact"), (t2, "release")
    )


def turning():
    """A leash of length 1 under a force that turns: the angle it lags behind is 2 arctan(1 + t) -
    pi/2."""
    lag = lambda t: 2 * np.arctan(1 + t) - np.pi / 2
    x = lambda t: [np.sin(t - lag(t)), -np.cos(t - lag(t))]
    impulse = lambda t: [
        np.log((1 + (1 + t) ** 2) / 2)
    ]  # lam = cos lag = 2 (1 + t) / (1 + (1 + t)^2)
    drift = lambda xp: lambda t, x: xp.stack((xp.sin(t) + 0.0 * x[0], -xp.cos(t) + 0.0 * x[1]))
    return known(
        drift, (Distance(d=1.0, sign=-1, anchors=np.zeros((1, 2))),), [0.0, -1.0], 8.0, x, impulse
    )


def wedge():
    """Two walls y >= s + x and y >= s - x, s = t + sin(2 t) / 4, lift a point that is pressed down:
    one, then both."""
    s = lambda t: t + np.sin(2 * t) / 4
    # falls from (1/4, 2): meets y = s + x where 2 - t = s + 1/4, then slides with x' = -(1 + s') /
    # 2 to x = 0
    t1 = float(mpmath.findroot(lambda t: 2 * t + mpmath.sin(2 * t) / 4 - mpmath.mpf(7) / 4, 0.7))
    t2 = float(mpmath.findroot(lambda t: t + s_mp(t) - t1 - s_mp(t1) - mpmath.mpf(1) / 2, 1.0))

    def x(t):
        q = 0.25 - 0.5 * (t - t1 + s(t) - s(t1))
        return [0.25, 2.0 - t] if t < t1 else [q, s(t) + q] if t < t2 else [0.0, s(t)]

    def impulse(t):  # one wall: lam = (1 + s') / 2; both: the same, shared
        load = lambda a, b: (max(0.0, b - a) + (s(max(a, b)) - s(a))) / 2
        return [load(t1, min(t, t2)) + load(t2, t), load(t2, t)]

    walls = Affine(
        [[-1.0, 1.0], [1.0, 1.0]], lambda xp: lambda t: -(t + xp.sin(2 * t) / 4) * xp.ones(2)
    )
    return known(down, (walls,), [0.25, 2.0], 4.0, x, impulse, (t1, "contact"), (t2, "contact"))


def s_mp(t):
    return t + mpmath.sin(2 * t) / 4


def train():
    """On a line: one pulls another by a link, taut at t = 1/2, to a wall at t = 5/2; the link stays
    taut without load."""
    drift = lambda xp: lambda t, x: xp.stack((0.0 * x[0], 1.0 + 0.0 * x[1]))
    m = lambda t: np.clip(t, 0.5, 2.5) - 0.5
    x = lambda t: [m(t) / 2, 1.5 + min(t, 0.5) + m(t) / 2]
    link = Distance(d=2.0, sign=-1, pairs=[[0, 1]], dim=1)
    return known(
        drift,
        (link, Affine([[0.0, -1.0]], [3.0])),
        [0.0, 1.5],
        4.0,
        x,
        lambda t: [m(t) / 2, max(0.0, t - 2.5)],
        (0.5, "contact"),
        (2.5, "contact"),
        (2.5, "release"),
    )


def ball():
    """In space, pushed head on by a moving ball that then returns: x = 1 + 2 sin t up to t =
    pi/2."""
    anchor = lambda xp: lambda t: xp.stack((2 * xp.sin(t), 0.0 * t, 0.0 * t)).reshape((1, 3))
    top = lambda t: max(1.0, 2 * np.sin(min(t, np.pi / 2)))
    return known(
        lambda xp: lambda t, x: 0.0 * x,
        (Distance(d=1.0, dim=3, anchors=anchor),),
        [2.0, 0.0, 0.0],
        3.0,
        lambda t: [1.0 + top(t), 0.0, 0.0],
        lambda t: [top(t) - 1.0],
        (np.pi / 6, "contact"),
        (np.pi / 2, "release"),
    )


def forced():
    """Pressed to the floor and lifted in turns by -cos 5t + 1/5: contact again in each period, by
    Skorokhod's formula."""
    z = lambda t: 0.1 - np.sin(5 * t) / 5 + t / 5
    lows = [(np.arccos(0.2) + 2 * np.pi * k) / 5 for k in range(9)]  # z' = 0 upward: deepest points
    x_free = lambda t: min([z(s) for s in lows if s <= t] + [z(t), 0.0])
    hits = [
        float(
            mpmath.findroot(
                lambda t: mpmath.mpf(1) / 10 - mpmath.sin(5 * t) / 5 + t / 5,
                (0.1, 0.15),
                solver="anderson",
            )
        )
    ]
    return known(
        lambda xp: lambda t, x: (0.2 - xp.cos(5 * t)) * xp.ones_like(x),
        (Affine([[1.0]], [0.0]),),
        [0.1],
        6.0,
        lambda t: [z(t) - x_free(t)],
        lambda t: [-x_free(t)],
        (hits[0], "contact"),
        (lows[0], "release"),
    )


def jump():
    """The load jumps from 1 to 3 and to -1: held, held, gone."""
    drift = lambda xp: (
        lambda t, x: xp.where(t < 1.0, -1.0, xp.where(t < 2.0, -3.0, 1.0)) * xp.ones_like(x)
    )
    return known(
        drift,
        (Affine([[1.0]], [0.0]),),
        [0.5],
        3.0,
        lambda t: [max(0.0, 0.5 - t) if t < 2.0 else t - 2.0],
        lambda t: [np.clip(t, 0.5, 1) - 0.5 + 3 * (np.clip(t, 1, 2) - 1)],
        (0.5, "contact"),
        (2.0, "release"),
    )


SCENES = {
    "roll": lambda: roll(Distance(d=1.0, anchors=np.zeros((1, 2)))),
    "roll_smooth": lambda: roll(
        Smooth(lambda xp: lambda t, x: (xp.sqrt(x[0] ** 2 + x[1] ** 2) - 1.0).reshape((1,)))
    ),
    "ellipse": ellipse,
    "turning": turning,
    "wedge": wedge,
    "train": train,
    "ball": ball,
    "forced": forced,
    "jump": jump,
}


@pytest.mark.parametrize("name", SCENES)
def test_the_closed_form_satisfies_its_equation(name):
    k = SCENES[name]()
    view = ConstraintSet(k.case.problem, k.case.n)
    f = k.case.problem.drift(np)
    h = 1e-5
    for t in np.linspace(0.05, k.case.t[-1] - 0.05, 23):
        if min([abs(t - e) for e, _ in k.events] + [abs(t - s) for s in (1.0, 2.0)] + [1.0]) < 1e-3:
            continue
        x = np.array(k.x(t))
        near = view.near(x, 100.0, t)
        lam = (np.array(k.impulse(t + h)) - k.impulse(t - h)) / (2 * h)
        slope = (np.array(k.x(t + h)) - k.x(t - h)) / (2 * h)
        assert np.abs(slope - f(t, x) - lam @ view.dense_gradients(t, x, near)).max() < 1e-5
        g = view.gaps(t, x, near)
        assert g.min() > -1e-12 and lam.min() > -1e-5 and np.abs(g * lam).max() < 1e-5


@pytest.mark.long
@pytest.mark.parametrize("name", SCENES)
def test_the_run_meets_the_closed_form(name):
    k = SCENES[name]()
    traj = solve(k.case, "event_driven")
    assert traj.status.ok, traj.status
    assert np.abs(traj.x - [k.x(t) for t in traj.t]).max() <= 1e-12
    order = sorted(range(len(traj.contacts)), key=lambda j: traj.contacts[j])
    assert np.abs(traj.impulse[:, order] - [k.impulse(t) for t in traj.t]).max() <= 1e-11
    found = [(e.t, e.kind) for e in traj.events][: len(k.events)]
    assert [kind for _, kind in found] == [kind for _, kind in k.events]
    assert all(abs(a - b) <= 1e-11 for (a, _), (b, _) in zip(found, k.events, strict=True))
    assert len(traj.events) == len(k.events) or name == "forced"


@pytest.mark.parametrize("place", [3.0, -2.0])
def test_a_disc_is_met_away_from_the_origin_and_at_its_own_distance(place):
    way = np.sign(place)
    drift = lambda xp: lambda t, x: way + 0.0 * x
    post = Distance(d=0.5, anchors=np.array([[place]]), dim=1)
    case = Case("post", Complementarity(drift, (post,)), np.ones(1), np.linspace(0.0, 4.0, 9))
    run = solve(case, "event_driven")
    way_there = abs(place - 1.0) - 0.5
    assert run.stats["loop"] == "compiled"
    assert np.abs(run.x[:, 0] - 1.0 - way * np.minimum(run.t, way_there)).max() < 1e-12
    assert [e.t for e in run.events] == pytest.approx([way_there], abs=1e-12)
