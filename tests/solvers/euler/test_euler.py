"""Euler has order one on fields with signs, implicitly without chatter, in compiled and in plain
Python alike."""

import numpy as np
import pytest
from nsbench.cases import slide_exit

from nsbench import Affine, Case, Complementarity, Filippov, get_case, solve

IMPLICIT = "euler[implicit=true]"
STEPS = 0.05 / np.array(
    [1, 2, 3, 5, 8, 13, 21, 34, 55]
)  # divide the sample spacing; no dyadic ratio


def states(xp):
    return lambda t, x: x + 0.0


def host(drift):
    """The drift made opaque to numba, which knows no einsum: the loops then run in Python."""

    def make(xp):
        f = drift(xp)
        return lambda t, x, *s: xp.einsum("i->i", f(t, x, *s))

    return make


def smooth(f, x0=(1.0,), T=1.0):
    """A plain equation, run in Python: no time to compile."""
    return Case(
        "smooth",
        Complementarity(host(lambda xp: lambda t, x: f(xp, t, x))),
        np.array(x0),
        np.linspace(0, T, 11),
    )


def slopes(spec):
    runs = [solve(get_case("slide_exit"), spec, h=h) for h in STEPS]
    h = np.log([r.stats["h"] for r in runs])
    return (
        np.polyfit(h, np.log([np.abs(r.x[-1] - slide_exit.END).max() for r in runs]), 1)[0],
        np.polyfit(h, np.log([abs(r.impulse[-1, 0] - slide_exit.WEIGHT) for r in runs]), 1)[0],
    )


def test_implicit_has_order_one_in_state_and_impulse():
    assert np.allclose(slopes(IMPLICIT), 1.0, atol=0.05)


def test_explicit_has_order_one_erratically():
    assert np.allclose(slopes("euler"), 1.0, atol=0.3)


def test_implicit_does_not_chatter():
    case = get_case("sliding")
    traj = solve(case, IMPLICIT, h=0.007)
    assert traj.status.ok and traj.contacts == ((0, 0),) and traj.reaction.shape == (41, 0)
    on = case.t > 0.5 + 0.007
    assert np.abs(traj.x[on, 1]).max() < 1e-14
    weights = np.diff(traj.impulse[on, 0]) / np.diff(case.t[on])
    np.testing.assert_allclose(weights, 0.5, atol=1e-12)
    np.testing.assert_allclose(traj.x, case.exact(case.t), atol=1e-12)
    np.testing.assert_allclose(traj.impulse, case.exact_impulse(case.t), atol=1e-12)


@pytest.mark.parametrize("h", [0.2, 0.09, 0.04])
def test_explicit_chatters_about_the_surface_with_the_size_of_its_step(h):
    case = get_case("sliding").replace(
        t=np.append(np.arange(0.0, 2.0, h), 2.0)
    )  # the polygon itself
    traj = solve(case, "euler", h=h)
    height = traj.x[case.t > 0.5 + h, 1]
    assert traj.status.ok and np.abs(height).max() <= h * (1 + 1e-9)
    assert (
        np.sum(height >= 0) >= len(height) // 2 - 1 and np.sum(height < 0) >= len(height) // 2 - 1
    )
    weights = np.diff(traj.impulse[:, 0]) / np.diff(case.t)
    assert set(np.round(weights, 9)) == {0.0, 1.0}
    assert abs(traj.impulse[-1, 0] - case.exact_impulse(np.array([2.0]))[0, 0]) <= h
    coarse = solve(get_case("sliding"), "euler", h=h)
    if h > 0.05:  # above the sample spacing: same polygon, sampled
        assert coarse.stats["steps"] == len(case.t) - 1 and coarse.stats["h"] == h
        np.testing.assert_allclose(coarse.x[-1], traj.x[-1], atol=1e-13)


def test_on_the_surface_explicit_takes_the_positive_side():
    traj = solve(get_case("apple_filippov[y0=0.0]"), "euler", h=0.05)
    np.testing.assert_allclose(traj.x[1:, 0], -0.05, atol=1e-15)
    np.testing.assert_allclose(
        solve(get_case("apple_filippov[y0=0.0]"), IMPLICIT, h=0.05).x, 0.0, atol=1e-15
    )
    np.testing.assert_allclose(
        solve(get_case("apple_filippov[y0=-0.5]"), IMPLICIT, h=0.05).x, -0.5, atol=1e-15
    )


@pytest.mark.long
@pytest.mark.parametrize("spec", ["euler", IMPLICIT])
def test_compiled_and_python_loops_give_the_same_bits(spec):
    case = get_case("oscillator")
    p = case.problem
    fast, slow = (
        solve(c, spec, h=0.01)
        for c in (case, case.replace(problem=Filippov.signs(host(p.field), p.switch)))
    )
    assert (fast.stats.pop("loop"), slow.stats.pop("loop")) == ("compiled", "host")
    slow.stats.pop("note")
    assert fast.x.tobytes() == slow.x.tobytes() and fast.impulse.tobytes() == slow.impulse.tobytes()
    assert fast.stats == slow.stats


@pytest.mark.parametrize(
    "f", [lambda xp, t, x: x, host(lambda xp: lambda t, x: x)], ids=["compiled", "host"]
)
def test_plain_equations_are_solved_by_the_textbook_methods(f):
    drift = (lambda xp: lambda t, x: x) if f.__code__.co_argcount == 3 else f
    case = Case("grow", Complementarity(drift), np.array([1.0]), np.linspace(0, 1, 11))
    k = 10 * np.arange(11)
    one = solve(case, "euler", h=0.01)
    two = solve(case, IMPLICIT, h=0.01)
    np.testing.assert_allclose(one.x[:, 0], 1.01**k, rtol=1e-14)
    np.testing.assert_allclose(two.x[:, 0], 0.99**-k, rtol=1e-13)
    assert (
        one.contacts == ()
        and one.impulse.shape == (11, 0)
        and np.array_equal(one.reaction, np.zeros((11, 1)))
    )
    assert one.stats["steps"] == one.stats["drift_calls"] == 100


def test_implicit_is_stable_where_explicit_is_not():
    case = smooth(lambda xp, t, x: -1e4 * (x - xp.cos(t)), (0.0,))
    assert abs(solve(case, IMPLICIT, h=0.1).x[-1, 0] - np.cos(1)) < 1e-3
    assert solve(case, "euler", h=0.001).status.code == "diverged"
    assert abs(solve(case, "euler", h=0.0001).x[-1, 0] - np.cos(1)) < 1e-3


def test_implicit_rests_where_four_relays_meet():
    # x' = b - G s with G diagonally dominant: the origin is reached from anywhere, with s = G^-1 b
    # there
    G = np.eye(4) + 0.2 * np.ones((4, 4))
    b = np.array([0.5, -0.3, 0.2, 0.0])
    field = lambda xp: lambda t, x, s: b - xp.einsum("ij,j", G, s)
    case = Case(
        "corner",
        Filippov.signs(field, states),
        np.array([1.0, -0.5, 0.7, 0.1]),
        np.linspace(0, 4, 21),
    )
    traj = solve(case, IMPLICIT, h=0.03)
    assert traj.status.ok and np.abs(traj.x[-10:]).max() < 1e-14
    theta = np.diff(traj.impulse, axis=0)[-5:] / np.diff(case.t)[-5:, None]
    np.testing.assert_allclose(
        theta, np.tile(0.5 + 0.5 * np.linalg.solve(G, b), (5, 1)), atol=1e-11
    )


FAILURES = {
    "nan": (lambda xp, t, x: x + xp.log(0.543 - t), "nan", "nan"),
    "blow-up": (
        lambda xp, t, x: x**3 + 3 * x,
        "diverged",
        "maxiter",
    ),  # the implicit equation loses its root
}


@pytest.mark.parametrize("name", FAILURES)
def test_failures_are_statuses_and_the_rest_is_nan(name):
    f, *codes = FAILURES[name]
    for spec, code in zip(("euler", IMPLICIT), codes, strict=True):
        traj = solve(smooth(f), spec, h=0.01)
        gone = np.isnan(traj.x[:, 0])
        assert traj.status.code == code and "t = " in str(traj.status)
        assert gone[-1] and not gone[0] and np.all(np.diff(gone.astype(int)) >= 0)


def test_what_euler_refuses():
    kept = Case(
        "kept",
        Complementarity(states, (Affine(np.eye(1), np.zeros(1)),)),
        np.ones(1),
        np.linspace(0, 1, 3),
    )
    traj = solve(kept, "euler")
    assert traj.status.code == "refused" and "use pbd or catching_up" in str(traj.status)
    with pytest.raises(ValueError, match="implicit is 3"):
        solve(kept, "euler[implicit=3]")
    for h in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(ValueError, match="h is"):
            solve(get_case("sliding"), "euler", h=h)


@pytest.mark.long
def test_steps_whose_roundings_may_be_the_motion_are_not_called_ok():
    def far(away):
        problem = Filippov.signs(
            lambda xp: lambda t, x, s: xp.array([-0.5 - 0.1 * s[0]]),
            lambda xp: lambda t, x: xp.array([x[0] - away]),
        )
        return Case("far", problem, [away + 0.2], np.linspace(0.0, 1.0, 6))

    short = solve(far(1e8), "euler", h=1e-6)
    assert short.status.code == "unverified" and "rounding" in str(short.status)
    assert solve(far(1e8), "euler", h=1e-3).status.ok and solve(far(1.0), "euler", h=1e-6).status.ok


def test_a_state_that_is_held_is_not_rounding():
    problem = Filippov.signs(
        lambda xp: lambda t, x, s: xp.array([-0.5 * s[0]]),
        lambda xp: lambda t, x: xp.array([x[0] - 3.0]),
    )
    held = Case("held", problem, [3.0], np.linspace(0.0, 1.0, 6))
    assert solve(held, IMPLICIT, h=1e-5).status.ok


@pytest.mark.long
@pytest.mark.parametrize("far", (0.0, 1e4, 1e8, -1e8))
def test_implicit_takes_its_differences_in_the_length_of_a_switch_however_far(far):
    """x' = 1/4 - sign(sin 9 x), seen from far: a difference of 1e-8 of the coordinate would be ten
    lengths of the switch."""
    relay = Filippov.signs(
        lambda xp: lambda t, x, s: 0.25 - s + 0.0 * x,
        lambda xp: lambda t, x: xp.sin(9.0 * (x - far)),
    )
    case = Case("far", relay, np.array([far + 0.25]), np.linspace(0.0, 1.0, 6))
    traj = solve(case, IMPLICIT, h=1e-5)
    assert traj.status.ok and traj.stats["inner_iterations"] < 3.5 * traj.stats["steps"]
    assert traj.x[2:, 0] - far == pytest.approx(np.zeros(4), abs=4e-8)


@pytest.mark.parametrize("h", [1e-3, 1e-5, 2e-6])
def test_implicit_steps_far_away_do_not_slide_on_what_rounding_leaves(h):
    """A step of 2e-6 is 130 spacings of a state of 1e8, and all steps may lose some: both fields
    leave the surface, which moves the other way."""
    field = lambda xp: lambda t, x, s: xp.array([-0.7 - 0.7 * s[0] * (-1.0)])
    case = Case(
        "far",
        Filippov.signs(field, lambda xp: lambda t, x: xp.array([x[0] - 1e8 - 0.41 * t])),
        np.array([1e8]),
        np.linspace(0.0, 0.1, 3),
    )
    run = solve(case, "euler[implicit=true]", h=h)
    assert (
        run.status.code == ("ok" if h > 2e-6 else "unverified")
        and abs(run.x[-1, 0] - 1e8 + 0.14) < 2e-3
    )
