"""Event-driven runs of Filippov systems reach closed forms to 1e-10."""

import numpy as np
import pytest
from filippov_factories import constant, drift, states, still
from filippov_runs import filippov, run, second
from nsbench.cases import slide_exit
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq

from nsbench import Filippov, get_case, solve

TOL = 1e-10  # what the method claims


def agrees(traj, x, impulse, events, tol=TOL):
    assert traj.status.ok, traj.status
    np.testing.assert_allclose(traj.x, x, rtol=0, atol=tol)
    np.testing.assert_allclose(traj.impulse, impulse, rtol=0, atol=tol)
    assert [(e.kind, e.contact) for e in traj.events] == [(kind, (0, i)) for _, kind, i in events]
    np.testing.assert_allclose(
        [e.t for e in traj.events], [t for t, _, _ in events], rtol=0, atol=tol
    )
    assert traj.reaction.shape == (len(x), 0)


KINDS = {
    "sliding": ["enter"],
    "oscillator": ["cross"],
    "apple_filippov": ["enter"],
    "apple_filippov[y0=-0.5]": [],
    "apple_filippov[y0=0]": [],
    "crossing": ["cross"],
    "friction": ["cross", "enter"],
}


@pytest.mark.parametrize("name", KINDS)
def test_a_case_with_a_closed_form_is_met(name):
    case = get_case(name)
    events = [(t, kind, 0) for t, kind in zip(case.exact_events, KINDS[name], strict=True)]
    agrees(run(case), case.exact(case.t), case.exact_impulse(case.t), events)


def test_the_numbers_of_slide_exit_hold_and_are_met():
    # an independent computation: a Runge-Kutta code for the free arcs, quadrature of dx1 / v(x1)
    # for the sliding one
    above = slide_exit.above(np)
    below = slide_exit.below(np)
    hit = lambda t, x: x[1]
    hit.terminal = True
    free = solve_ivp(above, (0, 1), [-0.5, 0.5], "DOP853", rtol=1e-13, atol=1e-14, events=hit)
    enter = free.t[-1]
    x1 = free.y[0, -1]
    weight = lambda u: (1 - u) / (2 - u + 0.5 * np.sin(u))
    speed = lambda u: weight(u) + (1 - weight(u)) * (2 + u * u / 4)
    leave = enter + quad(lambda u: 1 / speed(u), x1, 1, epsabs=1e-13)[0]
    end = solve_ivp(below, (leave, 1.5), [1.0, 0.0], "DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
    total = enter + quad(lambda u: weight(u) / speed(u), x1, 1, epsabs=1e-13)[0]
    found = np.array([enter, leave, *end, total])
    stated = np.array([slide_exit.ENTER, slide_exit.LEAVE, *slide_exit.END, slide_exit.WEIGHT])
    np.testing.assert_allclose(found, stated, rtol=0, atol=1e-11)
    traj = run(get_case("slide_exit"))
    assert [e.kind for e in traj.events] == ["enter", "exit"]
    np.testing.assert_allclose(
        [*(e.t for e in traj.events), *traj.x[-1], traj.impulse[-1, 0]], stated, rtol=0, atol=1e-12
    )


@pytest.mark.long
@pytest.mark.parametrize("method", ["rk45", "radau", "lsoda"])
def test_every_integrator_gets_there(method):
    traj = solve(get_case("slide_exit"), f"event_driven[method={method}]", tol=1e-9)
    assert np.abs(traj.x[-1] - slide_exit.END).max() < 1e-6, traj.status


def turning(xp, t, x, s):
    grow = 0.5 * xp.sin(t) - s[0]
    turn = 1.0 + 0.5 * s[0]
    return xp.array([grow * x[0] - turn * x[1], grow * x[1] + turn * x[0]])


SQUARE = drift(lambda xp, t, x: x[0:1] * x[0:1] + x[1:2] * x[1:2] - 1.0)
ROOT = drift(
    lambda xp, t, x: xp.abs(xp.sqrt(x[0:1] ** 2 + x[1:2] ** 2)) - 1.0
)  # abs: no complex step, so JAX


@pytest.mark.parametrize("circle", [SQUARE, ROOT], ids=["complex step", "jax"])
def test_a_curved_surface_with_a_moving_weight(circle):
    case = filippov(Filippov.signs(drift(turning), circle), (1.5, 0.0), 4.0)
    t = case.t
    log_r = lambda t: np.log(1.5) + 0.5 * (1 - np.cos(t)) - t
    t1 = brentq(log_r, 0, 2, xtol=1e-15)
    late = np.maximum(t, t1)
    angle = 1.5 * np.minimum(t, t1) + (late - t1) + 0.25 * (np.cos(t1) - np.cos(late))
    r = np.where(t < t1, np.exp(log_r(t)), 1.0)
    impulse = np.minimum(t, t1) + 0.5 * (late - t1) + 0.25 * (np.cos(t1) - np.cos(late))
    agrees(
        run(case),
        np.stack([r * np.cos(angle), r * np.sin(angle)], 1),
        impulse[:, None],
        [(t1, "enter", 0)],
    )


def test_two_relays_end_in_their_common_point():
    pull = drift(lambda xp, t, x: xp.array([0.5 * xp.sin(t), 0.5 * xp.cos(t)]))
    case = filippov(Filippov.relay(pull, -np.eye(2), states), (1.0, -0.7), 4.0)
    t = case.t
    f1 = lambda t: 1 - t + 0.5 * (1 - np.cos(t))
    f2 = lambda t: -0.7 + t + 0.5 * np.sin(t)
    t1 = brentq(f1, 0, 3, xtol=1e-15)
    t2 = brentq(f2, 0, 3, xtol=1e-15)
    a = np.maximum(t, t1)
    b = np.maximum(t, t2)
    impulse = np.stack(
        [
            np.minimum(t, t1) + 0.5 * (a - t1) + 0.25 * (np.cos(t1) - np.cos(a)),
            0.5 * (b - t2) + 0.25 * (np.sin(b) - np.sin(t2)),
        ],
        1,
    )
    agrees(
        run(case),
        np.stack([np.where(t < t1, f1(t), 0), np.where(t < t2, f2(t), 0)], 1),
        impulse,
        [(t2, "enter", 1), (t1, "enter", 0)],
    )


def test_dry_friction_in_two_dimensions_lets_go_twice():
    # starts at rest on both surfaces; each sticks while |load| <= 0.6 and leaves tangentially
    size = np.array([1.2, 0.9])
    load = drift(lambda xp, t, x: xp.array([1.2 * xp.sin(t), 0.9 * xp.sin(t)]))
    case = filippov(Filippov.relay(load, -0.6 * np.eye(2), states), (0.0, 0.0), 2.5)
    t = case.t[:, None]
    free = np.arcsin(0.6 / size)
    late = np.maximum(t, free)
    x = size * (np.cos(free) - np.cos(late)) - 0.6 * (late - free)
    stuck = np.minimum(t, free)
    impulse = 0.5 * stuck + size / 1.2 * (1 - np.cos(stuck)) + (late - free)
    agrees(run(case), x, impulse, [(free[0], "exit", 0), (free[1], "exit", 1)])


def test_a_moving_surface():
    case = filippov(
        Filippov.relay(still, np.array([[-2.0]]), drift(lambda xp, t, x: x - xp.sin(t))),
        (1.0,),
        4.0,
    )
    t1 = brentq(lambda t: 1 - 2 * t - np.sin(t), 0, 1, xtol=1e-15)
    t = case.t[:, None]
    late = np.maximum(t, t1)
    agrees(
        run(case),
        np.where(t < t1, 1 - 2 * t, np.sin(t)),
        np.minimum(t, t1) + 0.5 * (late - t1) - 0.25 * (np.sin(late) - np.sin(t1)),
        [(t1, "enter", 0)],
    )


def test_stick_slip_repeats_its_cycle():
    # slips at x1 = 1 whatever came before; the orbit after the first slip is one closed curve
    below = drift(lambda xp, t, x: xp.array([x[1], -x[0] + 1 / (1.2 - x[1])]))
    above = drift(lambda xp, t, x: xp.array([x[1], -x[0] - 1 / (0.8 + x[1])]))
    belt = drift(lambda xp, t, x: x[1:2] - 0.2)
    traj = run(filippov(Filippov({(1,): above, (-1,): below}, belt), (0.5, 0.0), 30.0))
    slips = [e.t for e in traj.events if e.kind == "exit"]
    sticks = [e.t for e in traj.events if e.kind == "enter"][1:]
    hit = lambda t, x: x[1] - 0.2 if t > 1 else -1.0
    hit.terminal = True
    free = solve_ivp(
        below(np), (0, 9), [1.0, 0.2], "DOP853", rtol=1e-13, atol=1e-14, events=hit, max_step=0.1
    )
    slip = free.t[-1]
    stick = (1 - free.y[0, -1]) / 0.2
    assert len(slips) >= 3
    np.testing.assert_allclose(np.diff(slips), slip + stick, rtol=0, atol=TOL)
    np.testing.assert_allclose(
        np.array(sticks[: len(slips)]) - slips[: len(sticks)], slip, rtol=0, atol=TOL
    )


def test_a_bilinear_blend_of_four_fields_slides_at_its_own_velocity():
    modes = {(1, 1): (-1, -1, 1), (1, -1): (-1, 2, 0), (-1, 1): (2, -1, 0), (-1, -1): (1.5, 1, 5)}
    pair = drift(lambda xp, t, x: x[:2])
    traj = run(
        filippov(
            Filippov({k: constant(*map(float, v)) for k, v in modes.items()}, pair),
            (0, 0, 0),
            1.0,
            11,
        )
    )
    a, b = traj.impulse[-1]
    v = sum(
        np.array(f) * (a if p > 0 else 1 - a) * (b if q > 0 else 1 - b)
        for (p, q), f in modes.items()
    )
    assert traj.status.ok and 0 < a < 1 and 0 < b < 1
    np.testing.assert_allclose(v[:2], 0, atol=1e-13)
    np.testing.assert_allclose(traj.x[-1], [0, 0, v[2]], atol=1e-13)


@pytest.mark.parametrize("depth", [1e-2, 1e-6, 1e-8])
def test_a_dip_through_the_surface_inside_one_step_is_found(depth):
    above = drift(lambda xp, t, x: xp.array([1.0, 2 * x[0]]))
    below = drift(lambda xp, t, x: xp.array([1.0, 4 * x[0]]))
    traj = run(filippov(Filippov({(1,): above, (-1,): below}, second), (-1.0, 1.0 - depth), 2.0, 2))
    w = np.sqrt(depth)
    agrees(
        traj,
        [[-1, 1 - depth], [1, 1 - depth]],
        [[0], [2 - 2 * w]],
        [(1 - w, "cross", 0), (1 + w, "cross", 0)],
    )


@pytest.mark.parametrize("ulps", range(-4, 5))
def test_an_event_at_the_end_time(ulps):
    traj = run(get_case("sliding").replace(t=np.linspace(0, 0.5 + ulps * np.spacing(0.25), 11)))
    assert traj.status.ok
    np.testing.assert_allclose(traj.x[-1], [0.5, 0.0], atol=1e-14)


def test_sliding_stays_on_the_surface_at_any_tolerance():
    case = filippov(Filippov.signs(drift(turning), SQUARE), (1.5, 0.0), 30.0)
    traj = solve(case, "event_driven", tol=1e-4)
    assert traj.status.ok and np.abs(np.hypot(*traj.x[2:].T) - 1).max() < 1e-14


@pytest.mark.long
@pytest.mark.parametrize("seed", [0, 10, 26])
def test_four_coupled_relays_agree_with_implicit_euler(seed):
    # c = x and a positive definite coupling: a maximal monotone problem, whose solution is unique
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(4, 4)) - 2 * np.eye(4)
    a = 1.5 * rng.normal(size=4)
    w = rng.uniform(1, 4, 4)
    R = 0.3 * rng.normal(size=(4, 4))
    load = drift(
        lambda xp, t, x: xp.einsum("ij,j", A, x) + a * xp.sin(w * t)
    )  # einsum: Euler's loop in Python
    case = filippov(
        Filippov.relay(load, -(R @ R.T + 0.5 * np.eye(4)), states), rng.normal(size=4), 2.0, 11
    )
    traj = run(case)
    steps = np.array([0.04, 0.02, 0.01])
    euler = [solve(case, "euler[implicit=true]", h=h) for h in steps]
    assert traj.status.ok and len(traj.events) >= 4 and euler[0].stats["loop"] == "host"
    for name in ("x", "impulse"):
        one, two, four = (getattr(e, name) for e in euler)
        gone = [np.abs(e - getattr(traj, name)).max() for e in (one, two, four)]
        assert gone[0] < 5 * steps[0] and gone[2] < 0.4 * gone[0]
