"""Event-driven runs of constrained systems agree with closed forms and with themselves, or say why
they ended."""

import dataclasses

import numpy as np
import pytest
from event_scenes import floor, push, scene

from nsbench import Affine, Distance
from nsbench.case import get_case
from nsbench.solvers import solve
from nsbench.solvers.event_driven.contacts import evaluation

KNOWN = [
    "apple",
    "tide",
    "smooth",
    "wedge",
    "two_discs",
    "rods[n=5]",
    "rods[n=10]",
    "hex[n=7]",
    "hex[n=19]",
    "duplicate",
    "chain",
    "chain[pull=last]",
    "chain[hanging=rest]",
    "stack[n=6]",
    "stack[n=3,columns=3]",
]


def columns(case, traj):
    """Impulses in the order of the case's contacts; contacts that never acted are zero, others are
    a failure."""
    ids = case.contacts or [
        (k, i) for k, c in enumerate(case.problem.constraints) for i in range(c.shape[0])
    ]
    assert set(traj.contacts) <= set(ids)
    out = np.zeros((len(traj.t), len(ids)))
    for j, c in enumerate(traj.contacts):
        out[:, ids.index(c)] = traj.impulse[:, j]
    return out


@pytest.mark.long
@pytest.mark.parametrize("spec", KNOWN)
def test_closed_forms_are_met(spec):
    case = get_case(spec)
    traj = solve(case, "event_driven")
    assert traj.status.ok, traj.status
    assert np.abs(traj.x - case.exact(case.t)).max() <= 1e-12
    if case.exact_impulse is not None:
        assert np.abs(columns(case, traj) - case.exact_impulse(case.t)).max() <= 1e-11
    if case.exact_events is not None:
        found = np.unique([e.t for e in traj.events])
        known = np.array(case.exact_events)
        assert all(np.abs(found - t).min() <= 1e-10 for t in known), "an event was missed"
        assert all(np.abs(known - t).min() <= 1e-10 for t in found), "an event was invented"


def test_tide_has_one_contact_and_one_release():
    assert [(e.kind, e.contact) for e in solve("tide").events] == [
        ("contact", (0, 0)),
        ("release", (0, 0)),
    ]


@pytest.mark.parametrize("method, tol", [("rk45", 1e-12), ("radau", 1e-9), ("lsoda", 1e-11)])
def test_other_integrators_meet_the_tide(method, tol):
    case = get_case("tide")
    traj = solve(case, f"event_driven[method={method}]", tol=tol)
    assert (
        traj.status.ok and np.abs(traj.x - case.exact(case.t)).max() < 1e-8 * (tol / 1e-12) ** 0.3
    )


@pytest.mark.survives("dependent constraints")
def test_duplicate_walls_share_one_load():
    case = get_case("duplicate")
    traj = solve(case)
    np.testing.assert_allclose(
        traj.impulse.sum(axis=1), get_case("tide").exact_impulse(case.t)[:, 0], atol=1e-11
    )


def agree(a, b, bound):
    assert a.status.ok and b.status.ok
    assert np.abs(a.x - b.x).max() <= bound and np.abs(a.reaction - b.reaction).max() <= 10 * bound


@pytest.mark.parametrize(
    "spec",
    [
        "discs[n=3]",
        "discs[n=10,seed=1]",
        "discs[n=30]",
        "discs[n=10,seed=3,box=true]",
        "three_discs",
        "chain[zigzag=0.3]",
        "chain[hanging=fall,n=8]",
    ],
)
def test_two_tolerances_agree(spec):
    agree(solve(get_case(spec), tol=1e-12), solve(get_case(spec), tol=3e-11), 1e-10)


@pytest.mark.parametrize("spec", ["discs[n=3,seed=2]", "discs[n=10]"])
def test_two_integrators_agree(spec):
    agree(solve(get_case(spec)), solve(get_case(spec), "event_driven[method=rk45]"), 1e-11)


def test_near_lists_with_a_certificate_change_nothing(monkeypatch):
    whole = solve(get_case("discs[n=30,seed=1]"))
    monkeypatch.setattr(evaluation, "MAX_UNCERTIFIED_PAIRS", 0)
    near = solve(get_case("discs[n=30,seed=1]"))
    assert near.stats["restarts"] > whole.stats["restarts"]
    agree(near, whole, 1e-11)


def fine(case, k):
    return case.replace(t=np.linspace(case.t[0], case.t[-1], k), exact=None, exact_impulse=None)


@pytest.mark.parametrize(
    "spec", ["discs[n=10,seed=2]", "hex[n=7]", "chain[hanging=fall,n=5]", "discs[n=6,box=true]"]
)
def test_the_run_satisfies_its_inclusion(spec):
    """Feasible, multipliers not negative, loads on closed contacts only, x' = f + reaction: checked
    from samples."""
    from nsbench.dynamics.contacts.constraint_set import ConstraintSet

    case = fine(get_case(spec), 1201)
    traj = solve(case)
    assert traj.status.ok
    view = ConstraintSet(case.problem, case.n)
    f = case.problem.drift(np)
    h = case.t[1] - case.t[0]
    gaps = []
    index = None
    for t, x in zip(case.t, traj.x, strict=True):
        near = view.near(x, 100.0, t)
        index = {c: k for k, c in enumerate(near.ids)}
        gaps.append(view.gaps(t, x, near))
    gaps = np.array(gaps)
    assert gaps.min() >= -1e-12
    load = np.diff(traj.impulse, axis=0)
    assert load.min() >= -1e-12
    acting = gaps[:, [index[c] for c in traj.contacts]]
    speed = np.abs(np.diff(acting, axis=0)).max() + 1e-9
    assert np.all(np.minimum(acting[1:], acting[:-1])[load > 1e-11] <= speed)
    kinks = np.searchsorted(case.t, [e.t for e in traj.events])
    smooth = np.setdiff1d(
        np.arange(1, len(case.t) - 1), np.concatenate((kinks, kinks - 1, kinks + 1))
    )
    F = np.array([f(t, x) for t, x in zip(case.t, traj.x, strict=True)])
    simpson = h / 3 * (F[:-2] + 4 * F[1:-1] + F[2:])
    rest = (traj.x[2:] - traj.x[:-2] - simpson - (traj.reaction[2:] - traj.reaction[:-2]))[
        smooth - 1
    ]
    assert np.abs(rest).max() <= 1e-10
    for k in smooth[::37]:
        near = view.near(traj.x[k], 100.0, case.t[k])
        G = view.dense_gradients(case.t[k], traj.x[k], near)[[index[c] for c in traj.contacts]]
        lam = (traj.impulse[k + 1] - traj.impulse[k - 1]) / (2 * h)
        rate = (traj.reaction[k + 1] - traj.reaction[k - 1]) / (2 * h)
        assert np.abs(G.T @ lam - rate).max() <= 1e-3 * (1 + np.abs(rate).max())


def test_sweeps_of_small_steps_tend_to_the_run():
    """Another method altogether, of order one; its extrapolation is far closer than itself."""
    case = get_case("discs[n=10]")
    run = solve(case)
    coarse, small = (solve(case, "pbd", h=h).x[-1] for h in (5e-4, 2.5e-4))
    itself = np.abs(small - run.x[-1]).max()
    extrapolated = np.abs(2 * small - coarse - run.x[-1]).max()
    assert itself < 2e-3 and extrapolated < 0.02 * itself


@pytest.mark.long
@pytest.mark.parametrize(
    "K, spec, tol, bound",
    [
        (100, "event_driven", 1e-12, 1e-11),
        (1e4, "event_driven", 1e-12, 1e-11),
        (1e6, "event_driven", 1e-12, 1e-11),
        (1e4, "event_driven[method=radau]", 1e-9, 1e-7),
    ],
)
def test_stiff_contacts(K, spec, tol, bound):
    """x' = -K (x - cos t) - sin t above zero: held from pi/2 until K cos t = sin t."""
    case = scene(
        lambda xp: lambda t, x: -K * (x - xp.cos(t)) - xp.sin(t),
        floor(),
        x0=[1.0],
        t=np.linspace(0, 6, 31),
    )
    free = np.pi + np.arctan(K)
    late = np.cos(case.t) - np.cos(free) * np.exp(-K * np.maximum(case.t - free, 0))
    exact = np.where(case.t < np.pi / 2, np.cos(case.t), np.where(case.t < free, 0, late))
    traj = solve(case, spec, tol=tol)
    assert traj.status.ok and np.abs(traj.x[:, 0] - exact).max() < bound
    assert traj.stats["steps"] < 3000, "an explicit method takes 30 000 at K = 1e4"


@pytest.mark.parametrize("power", [1, 2, 3])
def test_a_load_that_grows_from_nothing_is_held_from_the_start(power):
    """x' = -t^p + lam at rest: undecided at t = 0, where neither speed nor multiplier shows."""
    case = scene(
        lambda xp: lambda t, x: -(t**power) * xp.ones_like(x),
        floor(),
        x0=[0.0],
        t=np.linspace(0, 2, 9),
    )
    traj = solve(case)
    assert traj.status.ok and traj.events == ()
    assert np.abs(traj.impulse[:, 0] - case.t ** (power + 1) / (power + 1)).max() < 1e-12


def test_a_load_that_vanishes_for_an_instant_stays():
    case = scene(
        lambda xp: lambda t, x: -((1 - t) ** 2) * xp.ones_like(x),
        floor(),
        x0=[0.0],
        t=np.linspace(0, 2, 8),
    )
    traj = solve(case)
    assert traj.status.ok and np.abs(traj.x).max() < 1e-12
    assert np.abs(traj.impulse[:, 0] - (1 - (1 - case.t) ** 3) / 3).max() < 1e-12


def test_a_held_contact_does_not_drift_off_at_any_tolerance():
    leash = Distance(
        d=1.0, sign=-1, anchors=lambda xp: lambda t: xp.stack((t, xp.sin(t))).reshape((1, 2))
    )
    traj = solve(scene(push(0.0, 0.0), leash, x0=[0.0, 1.0], t=np.linspace(0, 6, 13)), tol=1e-5)
    away = np.hypot(traj.x[:, 0] - traj.t, traj.x[:, 1] - np.sin(traj.t))
    assert traj.status.ok and np.abs(away[3:] - 1).max() < 1e-14


@pytest.mark.survives("event at a sample")
def test_events_at_samples_and_at_the_end():
    for t in ([0, 0.5, 1.0], [0, 0.5, 1.0, 2.0], [0, 1.5]):
        case = scene(push(-1.0), floor(), x0=[1.0], t=t)
        traj = solve(case)
        assert traj.status.ok and [e.t for e in traj.events] == pytest.approx([1.0], abs=1e-14)
        np.testing.assert_allclose(traj.x[:, 0], np.maximum(1 - case.t, 0), atol=1e-14)


@pytest.mark.survives("event at a sample")
def test_contact_from_the_start_is_no_event():
    traj = solve(
        scene(push(-1.0, 0.0), Affine(np.eye(2), np.zeros(2)), x0=[0.0, 0.0], t=[0, 0.5, 1])
    )
    assert traj.status.ok and traj.events == () and traj.contacts == ((0, 0),)
    np.testing.assert_allclose(traj.impulse[:, 0], [0, 0.5, 1], atol=1e-14)


def test_a_run_can_be_repeated():
    from nsbench.solvers import get

    run = get("event_driven").prepare(get_case("three_discs"), 1e-12)
    a = run()
    b = run()
    assert np.array_equal(a.x, b.x) and a.events == b.events
    assert dataclasses.replace(a).stats == b.stats
