"""The compiled walk of Filippov systems is the host's walk: the same motions and events, and
nothing hidden in a step."""

import math

import numpy as np
import pytest
from filippov_systems import ONE
from scipy.special import erf

from nsbench import Case, Filippov, get_case, solve
from nsbench.compilation.decorators import python_entry
from nsbench.solvers.event_driven.filippov import compiled_loop
from nsbench.solvers.event_driven.filippov.kernels import step_certificate
from nsbench.solvers.event_driven.filippov.kernels.enclosure import ORDER
from nsbench.solvers.event_driven.filippov.kernels.polynomial_root import (
    CLEAR,
    DEEP,
    FOUND,
    UNCLEAR,
)
from nsbench.solvers.event_driven.filippov.program import UntraceableError, trace_programs

CATALOGUE = (
    "slide_exit",
    "oscillator",
    "friction",
    "stick_slip",
    "circle_sliding",
    "crossing",
    "sliding",
)
MADE = (
    "moving_parabola",
    "entry_at_full_weight",
    "left_and_met_again",
    "bouncing_relay",
    "forced_1.7_relay",
    "small",
    "far",
)
drift = lambda f: lambda xp: lambda *a: f(xp, *a)


def made(name):
    problem, x0, T = ONE[name]()[:3]
    return Case("hostile", problem, np.array(x0, float), np.linspace(0.0, T, 41))


@pytest.mark.long
@pytest.mark.parametrize("name", CATALOGUE + MADE)
def test_states_weights_and_events_are_those_of_the_host(name):
    case = get_case(name) if name in CATALOGUE else made(name)
    one = solve(case, "event_driven")
    two = solve(case, "event_driven[compiled=false]")
    assert (one.stats["loop"], two.stats["loop"]) == ("compiled", "host") and one.stats[
        "roots"
    ] == "verified"
    assert one.status == two.status and one.stats["restarts"] == two.stats["restarts"]
    assert np.abs(one.x - two.x).max() <= 1e-12 * (1.0 + np.abs(two.x).max()) * (1.0 + case.t[-1])
    assert np.abs(one.impulse - two.impulse).max() <= 1e-12 * (1.0 + case.t[-1])
    assert [(e.kind, e.contact) for e in one.events] == [(e.kind, e.contact) for e in two.events]
    np.testing.assert_allclose(
        [e.t for e in one.events],
        [e.t for e in two.events],
        rtol=0,
        atol=1e-12 * (1.0 + case.t[-1]),
    )


def test_a_run_is_the_same_each_time_it_is_called():
    from nsbench.solvers.event_driven.method import EventDriven

    run = EventDriven().prepare(get_case("stick_slip"), 1e-12)
    one = run()
    two = run()
    assert np.array_equal(one.x, two.x) and one.events == two.events and one.stats == two.stats


@pytest.mark.parametrize("width", [1e-2, 1e-4])
def test_a_spike_of_the_drift_between_smooth_parts_is_integrated(width):
    # the series at the start knows nothing of it: all its coefficients underflow
    push = drift(
        lambda xp, t, x: xp.array([1.0, -1.0 + 5.0 * xp.exp(-(((t - 1.3) / width) ** 2))]) + 0.0 * x
    )
    case = Case(
        "spike",
        Filippov({(1,): push, (-1,): push}, drift(lambda xp, t, x: x[1:2] + 10.0)),
        np.array([0.0, 5.0]),
        np.array([0.0, 2.0]),
    )
    traj = solve(case, "event_driven")
    area = 2.5 * width * np.sqrt(np.pi) * (erf(0.7 / width) + erf(1.3 / width))
    assert traj.status.ok and traj.stats["loop"] == "compiled" and traj.stats["roots"] == "verified"
    assert abs(traj.x[-1, 1] - (3.0 + area)) < 1e-12


def test_events_are_found_at_loose_tolerances_too():
    for tol in (1e-4, 1e-6, 1e-8):
        traj = solve(get_case("stick_slip"), "event_driven", tol=tol)
        assert [e.kind for e in traj.events] == ["enter", "exit", "enter", "exit", "enter"], tol
        assert np.abs(traj.events[1].t - 2.76799522997745) < 10 * tol


def test_more_events_than_one_call_notes():
    swing = Filippov.relay(
        drift(lambda xp, t, x: xp.array([x[1], 0.0])),
        np.array([[0.0], [-1.0]]),
        drift(lambda xp, t, x: x[0:1]),
    )
    case = Case("long", swing, np.array([1.0, 0.0]), np.linspace(0.0, 800.0, 5))
    traj = solve(case, "event_driven")
    assert len(traj.events) > compiled_loop.MOST_LOGGED and traj.stats["loop"] == "compiled"
    q = np.sqrt(2.0)
    np.testing.assert_allclose(
        [e.t for e in traj.events], q * (2 * np.arange(len(traj.events)) + 1), rtol=1e-12
    )


def test_budgets_and_the_longest_step_are_kept():
    case = get_case("stick_slip")
    assert solve(case, "event_driven[max_events=2]").status.code == "chatter"
    few = solve(case, "event_driven[max_steps=7]")
    assert few.status.code == "maxiter" and few.stats["steps"] == 7
    assert solve(case, "event_driven[max_step=0.05]").stats["h"] <= 0.05


def test_what_cannot_be_traced_stays_with_the_host():
    lone = drift(lambda xp, t, x: xp.array([1.0, -1.0]) + 0.0 * xp.floor(x))
    case = Case(
        "kink",
        Filippov(
            {(1,): lone, (-1,): drift(lambda xp, t, x: xp.array([2.0, 1.0]))},
            drift(lambda xp, t, x: x[1:2]),
        ),
        np.array([0.0, 0.5]),
        np.linspace(0.0, 2.0, 5),
    )
    traj = solve(case, "event_driven")
    assert traj.stats["loop"] == "host" and np.abs(traj.x[-1] - [2.75, 0.0]).max() < 1e-12


def test_a_tape_that_is_not_the_case_is_not_used():
    # it depends on the namespace it is given: what is traced is not what is computed
    shifty = lambda xp: lambda t, x: xp.array([1.0 if xp is np else 2.0, -1.0]) + 0.0 * x
    problem = Filippov({(1,): shifty, (-1,): shifty}, drift(lambda xp, t, x: x[1:2]))
    with pytest.raises(UntraceableError, match="differs"):
        trace_programs(problem, 1, (0.0, 1.0), np.array([0.0, 0.5]))


def fall(c, error=1e-14):
    from numba import njit

    from nsbench.solvers.event_driven.filippov.kernels.polynomial_root import first_fall

    global FALL
    FALL = FALL or njit(lambda C, p, error, stack, work: first_fall(C, 0, p, error, stack, work))
    p = len(c) - 1
    return FALL(np.array([c]), p, error, np.zeros((2 * DEEP + 4, 2)), np.zeros((1, p + 1)))


FALL = None


def test_first_falls_of_random_polynomials():
    rng = np.random.default_rng(5)
    seen = 0
    for _ in range(300):
        roots = rng.uniform(-2.0, 2.0, 7)
        c = np.polynomial.polynomial.polyfromroots(roots)
        c *= np.sign(np.polynomial.polynomial.polyval(-1.0, c))
        inside = np.sort(roots[np.abs(roots) < 1.0])
        code, s = fall(c)
        if not inside.size:
            assert code == CLEAR
        elif np.diff(np.sort(roots)).min() > 1e-3:  # from a positive start the first root is a fall
            assert code == FOUND and abs(s - inside[0]) < 1e-9
            seen += 1
    assert seen > 100


def test_a_touch_is_not_decided_and_a_close_miss_is():
    square = lambda depth: np.array([0.09 - depth, -0.6, 1.0])  # (s - 0.3)^2 - depth
    assert fall(square(0.0))[0] == UNCLEAR and fall(square(-1e-12))[0] == CLEAR
    code, s = fall(square(1e-10))
    assert code == FOUND and abs(s - (0.3 - 1e-5)) < 1e-9


def test_a_piece_is_as_smooth_as_interpolation_at_its_nodes_says():
    """The watched function cos(s / 2) on |s| <= 1 is missed by (1/2)^12 / 12! times the largest
    product of distances to the nodes; a stricter bound costs pieces, a laxer one hides events."""
    s = np.linspace(-1.0, 1.0, 20_001)
    product = np.abs(np.prod(s[:, None] - step_certificate.NODES, axis=1)).max()
    missed = 0.5**ORDER / math.factorial(ORDER) * product
    M, R = np.zeros((2, 2, ORDER + 1))
    M[:, 0] = 1.0, 2.0
    M[0, ORDER] = 1e-30  # the field, as good as constant
    R[1, ORDER] = 0.5**ORDER / math.factorial(ORDER)
    outs = np.array([0, 1, -1])
    error = np.zeros(2)
    sizes = 1.0, 1.0, 1.0  # radius, least, pace
    smoothness = python_entry(step_certificate._smoothness)
    margin = smoothness(outs, 1, ORDER + 4, 2, *sizes, np.zeros((3, ORDER + 5)), M, R, error)
    assert error[0] == pytest.approx(missed, rel=1e-6)
    assert margin == pytest.approx(1e-10 * 2.0 / missed, rel=1e-6)


@pytest.mark.parametrize(
    "rates, certain",
    [((1.0, 0.0), 1.0), ((-0.04, 0.0), 0.0), ((-0.2, 0.0), -1.0), ((-0.1, 0.05), -1.0)],
)
def test_a_function_at_zero_is_lifted_stays_or_is_not_known(rates, certain):
    """Of a band of 0.1: beyond it at once, within half of it, beyond half of it below."""
    series = np.zeros((1, 9))
    series[0, 1:3] = rates
    assert python_entry(step_certificate.lift_time)(series, 0, 8, 1.0, 0.1) == certain


@pytest.mark.parametrize("lift, found", [((0.0, -1.0), 0), ((-1.0, 0.0), 1), ((0.0, 0.0), 1)])
def test_functions_that_are_not_lifted_yet_are_not_looked_at(lift, found):
    """Two watched functions fall to zero at 3/4 and at 5/8 of a piece of length 1."""
    Q = np.zeros((3, 3))
    Q[1, :2] = 0.5, -1.0
    Q[2, :2] = 0.25, -1.0
    scratch = np.zeros((2 * DEEP + 4, 2)), np.zeros((1, 3))
    args = np.arange(3), 1, 2, 2, 0.0, 1.0, Q.copy(), Q, np.zeros(2), np.array(lift)
    code, which, time = python_entry(step_certificate.first_event)(*args, *scratch)
    assert (code, which) == (FOUND, found)
    assert time == pytest.approx((0.75, 0.625)[found], rel=1e-12)
