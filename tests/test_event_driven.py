"""Event-driven runs of constrained systems agree with closed forms and with themselves, or say why they ended."""
import dataclasses

import numpy as np
import pytest

from nsbench import Affine, Case, Complementarity, Distance, Smooth
from nsbench.case import get_case
from nsbench.solvers import _contact_field, solve
from nsbench.solvers._arc import follow

KNOWN = ["apple", "tide", "smooth", "wedge", "two_discs", "rods[n=5]", "rods[n=10]", "hex[n=7]", "hex[n=19]",
         "duplicate", "chain", "chain[pull=last]", "chain[hanging=rest]", "stack[n=6]", "stack[n=3,columns=3]"]


def scene(drift, *constraints, x0, t, **more):
    return Case(name="scene", problem=Complementarity(drift, constraints), x0=np.array(x0, float),
                t=np.asarray(t, float), **more)


def push(*force):
    """A constant drift."""
    v = np.array(force)
    return lambda xp: lambda t, x: v + 0.0 * x


def floor(b=0.0):
    return Affine(np.eye(1), np.array([b]))


def columns(case, traj):
    """Impulses in the order of the case's contacts; contacts that never acted are zero, others are a failure."""
    ids = case.contacts or [(k, i) for k, c in enumerate(case.problem.constraints) for i in range(c.shape[0])]
    assert set(traj.contacts) <= set(ids)
    out = np.zeros((len(traj.t), len(ids)))
    for j, c in enumerate(traj.contacts):
        out[:, ids.index(c)] = traj.impulse[:, j]
    return out


@pytest.mark.parametrize("spec", KNOWN)
def test_closed_forms_are_met(spec):
    case = get_case(spec)
    traj = solve(case, "event_driven")
    assert traj.status.ok, traj.status
    assert np.abs(traj.x - case.exact(case.t)).max() <= 1e-11
    if case.exact_impulse is not None:
        assert np.abs(columns(case, traj) - case.exact_impulse(case.t)).max() <= 1e-10
    if case.exact_events is not None:
        found, known = np.unique([e.t for e in traj.events]), np.array(case.exact_events)
        assert all(np.abs(found - t).min() <= 1e-10 for t in known), "an event was missed"
        assert all(np.abs(known - t).min() <= 1e-10 for t in found), "an event was invented"


def test_tide_has_one_contact_and_one_release():
    assert [(e.kind, e.contact) for e in solve("tide").events] == [("contact", (0, 0)), ("release", (0, 0))]


@pytest.mark.parametrize("method, tol", [("rk45", 1e-12), ("radau", 1e-9), ("lsoda", 1e-11)])
def test_other_integrators_meet_the_tide(method, tol):
    case = get_case("tide")
    traj = solve(case, f"event_driven[method={method}]", tol=tol)
    assert traj.status.ok and np.abs(traj.x - case.exact(case.t)).max() < 1e-8 * (tol / 1e-12) ** 0.3


def test_duplicate_walls_share_one_load():
    case = get_case("duplicate")
    traj = solve(case)
    np.testing.assert_allclose(traj.impulse.sum(axis=1), get_case("tide").exact_impulse(case.t)[:, 0], atol=1e-11)


def agree(a, b, bound):
    assert a.status.ok and b.status.ok
    assert np.abs(a.x - b.x).max() <= bound and np.abs(a.reaction - b.reaction).max() <= 10 * bound


@pytest.mark.parametrize("spec", ["discs[n=3]", "discs[n=10,seed=1]", "discs[n=30]", "discs[n=10,seed=3,box=true]",
                                  "three_discs", "chain[zigzag=0.3]", "chain[hanging=fall,n=8]"])
def test_two_tolerances_agree(spec):
    agree(solve(get_case(spec), tol=1e-12), solve(get_case(spec), tol=3e-11), 1e-10)


@pytest.mark.parametrize("spec", ["discs[n=3,seed=2]", "discs[n=10]"])
def test_two_integrators_agree(spec):
    agree(solve(get_case(spec)), solve(get_case(spec), "event_driven[method=rk45]"), 1e-11)


def test_near_lists_with_a_certificate_change_nothing(monkeypatch):
    whole = solve(get_case("discs[n=30,seed=1]"))
    monkeypatch.setattr(_contact_field, "LISTED", 0)
    near = solve(get_case("discs[n=30,seed=1]"))
    assert near.stats["restarts"] > whole.stats["restarts"]
    agree(near, whole, 1e-11)


def fine(case, k):
    return case.replace(t=np.linspace(case.t[0], case.t[-1], k), exact=None, exact_impulse=None)


@pytest.mark.parametrize("spec", ["discs[n=10,seed=2]", "hex[n=7]", "chain[hanging=fall,n=5]", "discs[n=6,box=true]"])
def test_the_run_satisfies_its_inclusion(spec):
    """Feasible, multipliers not negative, loads on closed contacts only, x' = f + reaction: checked from samples."""
    from nsbench.contacts import Scene
    case = fine(get_case(spec), 1201)
    traj = solve(case)
    assert traj.status.ok
    view, f, h = Scene(case.problem, case.n), case.problem.drift(np), case.t[1] - case.t[0]
    gaps, index = [], None
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
    smooth = np.setdiff1d(np.arange(1, len(case.t) - 1), np.concatenate((kinks, kinks - 1, kinks + 1)))
    F = np.array([f(t, x) for t, x in zip(case.t, traj.x, strict=True)])
    simpson = h / 3 * (F[:-2] + 4 * F[1:-1] + F[2:])
    rest = (traj.x[2:] - traj.x[:-2] - simpson - (traj.reaction[2:] - traj.reaction[:-2]))[smooth - 1]
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
    itself, extrapolated = np.abs(small - run.x[-1]).max(), np.abs(2 * small - coarse - run.x[-1]).max()
    assert itself < 2e-3 and extrapolated < 0.02 * itself


def test_a_moving_floor_pushes_with_its_speed():
    """g = x - a sin t, f = -b, a < b: never leaves; lam = b + a cos t."""
    a, b = 0.5, 1.0
    case = scene(push(-b), Affine(np.eye(1), lambda xp: lambda t: -a * xp.sin(t) * xp.ones(1)), x0=[0.0],
                 t=np.linspace(0, 10, 41))
    traj = solve(case)
    assert traj.status.ok and traj.events == ()
    assert np.abs(traj.x[:, 0] - a * np.sin(case.t)).max() < 1e-11
    assert np.abs(traj.impulse[:, 0] - b * case.t - a * np.sin(case.t)).max() < 1e-10


def test_a_fast_floor_throws_and_catches():
    """a > b: released where a cos t = -b, flies with slope -b, caught where a sin t meets the line."""
    from scipy.optimize import brentq
    a, b = 2.0, 1.0
    case = scene(push(-b), Affine(np.eye(1), lambda xp: lambda t: -a * xp.sin(t) * xp.ones(1)), x0=[0.0],
                 t=np.linspace(0, 6, 25))
    up = np.arccos(-b / a)
    down = brentq(lambda t: a * np.sin(up) - b * (t - up) - a * np.sin(t), up + 0.5, 6, xtol=1e-15)
    traj = solve(case)
    assert [e.kind for e in traj.events] == ["release", "contact"]
    np.testing.assert_allclose([e.t for e in traj.events], [up, down], atol=1e-11)


def test_a_dragged_point_draws_a_tractrix():
    leash = Distance(d=1.0, sign=-1, anchors=lambda xp: lambda t: xp.stack((t, 0 * t)).reshape((1, 2)))
    case = scene(push(0.0, 0.0), leash, x0=[0.0, 1.0], t=np.linspace(0, 4, 21))
    traj = solve(case)
    exact = np.stack((case.t - np.tanh(case.t), 1 / np.cosh(case.t)), axis=1)
    assert traj.status.ok and np.abs(traj.x - exact).max() < 1e-11


def test_a_smooth_constraint_is_the_distance_it_states():
    around = push(1.0, 0.0)
    t = np.linspace(0, 4, 17)
    disc = solve(scene(around, Distance(d=1.0, anchors=np.zeros((1, 2))), x0=[-2.0, 0.2], t=t))
    same = solve(scene(around, Smooth(lambda xp: lambda t, x: (xp.sqrt(x[0] ** 2 + x[1] ** 2) - 1) * xp.ones(1)),
                       x0=[-2.0, 0.2], t=t))
    agree(disc, same, 1e-11)
    assert [e.kind for e in disc.events] == ["contact", "release"]


@pytest.mark.parametrize("K, spec, tol, bound", [(100, "event_driven", 1e-12, 1e-11),
                                                 (1e4, "event_driven[method=radau]", 1e-9, 1e-7)])
def test_stiff_contacts(K, spec, tol, bound):
    """x' = -K (x - cos t) - sin t above zero: held from pi/2 until K cos t = sin t."""
    case = scene(lambda xp: lambda t, x: -K * (x - xp.cos(t)) - xp.sin(t), floor(), x0=[1.0], t=np.linspace(0, 6, 31))
    free = np.pi + np.arctan(K)
    late = np.cos(case.t) - np.cos(free) * np.exp(-K * np.maximum(case.t - free, 0))
    exact = np.where(case.t < np.pi / 2, np.cos(case.t), np.where(case.t < free, 0, late))
    traj = solve(case, spec, tol=tol)
    assert traj.status.ok and np.abs(traj.x[:, 0] - exact).max() < bound


def test_no_narrow_dip_is_missed():
    """200 parabolas that dip below zero by 1e-3 to 1e-12 somewhere inside a step."""
    rng = np.random.default_rng(0)
    for depth, where in zip(10.0 ** rng.uniform(-12, -3, 200), rng.uniform(0.2, 1.8, 200), strict=True):
        arc = follow(lambda t, y, w=where: np.array([2 * (t - w)]), 0.0, np.array([where**2 - depth]), 2.0,
                     lambda t, y: y, band=1e-14)
        assert arc.fired.size == 1
        assert abs(arc.t - (where - np.sqrt(depth))) < 1e-14 / np.sqrt(depth) + 1e-12


def test_bumps_of_a_wall_are_seen_though_the_drift_is_constant():
    for width in (0.1, 0.01, 0.003):
        arc = follow(lambda t, y: np.ones(1), 0.0, np.zeros(1), 3.0,
                     lambda t, y, w=width: 0.5 - np.exp(-((y - 1.2345) / w) ** 2), samples=np.linspace(0, 3, 61)[1:])
        assert arc.fired.size and arc.t == pytest.approx(1.2345 - width * np.sqrt(np.log(2)), abs=1e-13)


def test_the_first_crossing_of_a_wavy_wall_is_found_in_one_long_step():
    for waves in (7.0, 23.0, 61.0):
        wall = lambda y, w=waves: 1.0 - 0.3 * y - 0.5 * np.sin(w * y)
        arc = follow(lambda t, y: np.ones(1), 0.0, np.zeros(1), 4.0, lambda t, y, g=wall: g(y),
                     data=lambda t, y, g=wall: [g(y)])
        scan = np.linspace(0, 4, 400_001)
        first = scan[np.argmax(wall(scan) < 0)]
        assert arc.fired.size and first - 1e-5 <= arc.t <= first and arc.steps < 20


@pytest.mark.parametrize("method, tol, bound", [("dop853", 1e-6, 1e-6), ("rk45", 1e-8, 3e-8), ("radau", 1e-8, 3e-8)])
def test_events_carry_the_accuracy_of_the_step_not_of_the_dense_output(method, tol, bound):
    """A pendulum of period 2 pi: the dense output of these is 10 to 1000 times coarser than the step."""
    arc = follow(lambda t, y: np.array([y[1], -y[0]]), 0.0, np.array([0.0, 1.0]), 10.0, lambda t, y: y[:1],
                 method=method, rtol=tol, band=1e-14)
    assert abs(arc.t - np.pi) < bound and abs(arc.y[0]) <= 1e-14, "the event lies within the band that was asked for"
    assert abs(arc.y[1] + 1.0) < bound


@pytest.mark.parametrize("power", [1, 2, 3])
def test_a_load_that_grows_from_nothing_is_held_from_the_start(power):
    """x' = -t^p + lam at rest: undecided at t = 0, where neither speed nor multiplier shows."""
    case = scene(lambda xp: lambda t, x: -(t**power) * xp.ones_like(x), floor(), x0=[0.0], t=np.linspace(0, 2, 9))
    traj = solve(case)
    assert traj.status.ok and traj.events == ()
    assert np.abs(traj.impulse[:, 0] - case.t ** (power + 1) / (power + 1)).max() < 1e-12


def test_a_load_that_vanishes_for_an_instant_stays():
    case = scene(lambda xp: lambda t, x: -((1 - t) ** 2) * xp.ones_like(x), floor(), x0=[0.0], t=np.linspace(0, 2, 8))
    traj = solve(case)
    assert traj.status.ok and np.abs(traj.x).max() < 1e-12
    assert np.abs(traj.impulse[:, 0] - (1 - (1 - case.t) ** 3) / 3).max() < 1e-12


def test_a_held_contact_does_not_drift_off_at_any_tolerance():
    leash = Distance(d=1.0, sign=-1, anchors=lambda xp: lambda t: xp.stack((t, xp.sin(t))).reshape((1, 2)))
    traj = solve(scene(push(0.0, 0.0), leash, x0=[0.0, 1.0], t=np.linspace(0, 6, 13)), tol=1e-5)
    away = np.hypot(traj.x[:, 0] - traj.t, traj.x[:, 1] - np.sin(traj.t))
    assert traj.status.ok and np.abs(away[3:] - 1).max() < 1e-14


def test_events_at_samples_and_at_the_end():
    for t in ([0, 0.5, 1.0], [0, 0.5, 1.0, 2.0], [0, 1.5]):
        case = scene(push(-1.0), floor(), x0=[1.0], t=t)
        traj = solve(case)
        assert traj.status.ok and [e.t for e in traj.events] == pytest.approx([1.0], abs=1e-14)
        np.testing.assert_allclose(traj.x[:, 0], np.maximum(1 - case.t, 0), atol=1e-14)


def test_contact_from_the_start_is_no_event():
    traj = solve(scene(push(-1.0, 0.0), Affine(np.eye(2), np.zeros(2)), x0=[0.0, 0.0], t=[0, 0.5, 1]))
    assert traj.status.ok and traj.events == () and traj.contacts == ((0, 0),)
    np.testing.assert_allclose(traj.impulse[:, 0], [0, 0.5, 1], atol=1e-14)


def test_a_start_outside_is_refused_or_projected():
    case = scene(push(-1.0), floor(), x0=[-1.0], t=[0, 1])
    with pytest.raises(ValueError, match="violates"):
        solve(case)
    assert solve(case.replace(start="project")).x[:, 0] == pytest.approx([0.0, 0.0], abs=1e-12)
    assert solve(case.replace(start="keep")).status.code == "refused"


MOVING = Affine(np.array([[1.0], [-1.0]]), lambda xp: lambda t: xp.stack((-t, 2 - t)))
FAILURES = {
    "nan at the start": (lambda xp: lambda t, x: x * np.nan, floor(), [1.0], "nan"),
    "nan later": (lambda xp: lambda t, x: -xp.sqrt(2 - t) * xp.ones_like(x), floor(), [1.0], "nan"),
    "blow-up": (lambda xp: lambda t, x: x**2, floor(), [1.0], "diverged"),
    "walls that close": (push(0.0), MOVING, [0.5], "infeasible"),
    "no gradient": (push(-1.0), Smooth(lambda xp: lambda t, x: x**3, lambda xp: lambda t, x: np.diag(3 * x**2),
                                       lambda xp: lambda t, x: 0 * x), [1.0], "degenerate"),
    "no direction": (push(-1.0), Smooth(lambda xp: lambda t, x: 1 * x,
                                        lambda xp: lambda t, x: np.diag(np.where(x > 1e-6, 1.0, np.nan)),
                                        lambda xp: lambda t, x: 0 * x), [1.0], "degenerate"),
}


@pytest.mark.parametrize("name", FAILURES)
def test_failures_are_statuses(name):
    drift, constraint, x0, code = FAILURES[name]
    traj = solve(scene(drift, constraint, x0=x0, t=np.linspace(0, 4, 9)))
    assert traj.status.code == code and str(traj.status).endswith(".")
    assert np.isnan(traj.x[-1]).all() and np.isnan(traj.impulse[-1]).all() and np.isfinite(traj.x[0]).all()


@pytest.mark.parametrize("option, code", [("max_events=1", "chatter"), ("max_steps=7", "maxiter")])
def test_budgets_end_a_run(option, code):
    assert solve("tide", f"event_driven[{option}]").status.code == code


def test_bad_options_are_named():
    for spec in ("event_driven[method=euler]", "event_driven[max_events=0]", "event_driven[max_step=-1]"):
        with pytest.raises(ValueError, match=spec.partition("[")[2].partition("=")[0]):
            solve("tide", spec)


def test_a_run_can_be_repeated():
    from nsbench.solvers import get
    run = get("event_driven").prepare(get_case("three_discs"), 1e-12)
    a, b = run(), run()
    assert np.array_equal(a.x, b.x) and a.events == b.events
    assert dataclasses.replace(a).stats == b.stats
