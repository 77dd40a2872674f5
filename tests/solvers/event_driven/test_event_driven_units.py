"""Events and arcs of a scene are the same in any unit of length, at any tolerance."""

import numpy as np
import pytest

from nsbench import Affine, Case, Complementarity, Distance, Filippov, Smooth, solvers
from nsbench.dynamics.scaling.estimate import _krylov, case_scale


def pushed(unit):
    """Two discs driven against walls, together and apart again, in lengths of `unit`."""

    def drift(xp):
        return lambda t, x: (
            unit * xp.array([1.0 + 0.0 * t, -0.5 + 0.0 * t, -1.0 + 0.0 * t, 0.3 + 0.0 * t])
        )

    walls = Affine(np.eye(3, 4), unit * np.array([1.0, 0.3, 1.0]))
    return Case(
        name="pushed",
        problem=Complementarity(drift, (Distance(0.5 * unit), walls)),
        x0=unit * np.array([-0.5, 0.1, 0.5, 0.0]),
        t=np.linspace(0.0, 1.0, 5),
    )


@pytest.mark.parametrize("unit", (1e-4, 1e-8, 1e-10))
@pytest.mark.parametrize(
    "spec, tol, miss",
    (
        ("event_driven", 1e-6, 1e-9),
        ("event_driven", 1e-12, 1e-13),
        ("event_driven[method=rk45]", 1e-9, 1e-10),
    ),
)
def test_a_scene_is_followed_in_any_unit(unit, spec, tol, miss):
    exact = solvers.solve(pushed(1.0), "event_driven", tol=1e-12)
    run = solvers.solve(pushed(unit), spec, tol=tol)
    assert run.status.ok and [(e.kind, e.contact) for e in run.events] == [
        (e.kind, e.contact) for e in exact.events
    ]
    assert (
        np.abs(run.x / unit - exact.x).max() < miss
        and np.abs(run.impulse / unit - exact.impulse).max() < miss
    )


@pytest.mark.parametrize("unit", (1e-8, 1.0))
@pytest.mark.parametrize("second", (0.0, 0.01))
def test_surfaces_that_are_one_leave_many_motions_in_any_unit(unit, second):
    """Their switches differ by more than a factor; the motion is one where the second changes
    nothing."""

    def drift(xp):
        return lambda t, x: 0.0 * x

    def switch(xp):
        return lambda t, x: xp.array([xp.sin(9.0 * x[0] / unit), 1.5 * x[0] / unit])

    case = Case(
        name="one",
        problem=Filippov.relay(drift, unit * np.array([[-1.8, 0.0], [-1.0, second]]), switch),
        x0=unit * np.array([0.0, 0.3]),
        t=np.linspace(0.0, 0.7, 5),
    )
    assert solvers.solve(case, "event_driven").status.code == ("degenerate" if second else "ok")


@pytest.mark.parametrize("unit", (1e-8, 1.0))
def test_a_gradient_that_vanishes_is_seen_in_any_unit(unit):
    """x^3 >= 0, driven down: at 0 no direction leads away."""
    g = Smooth(lambda xp: lambda t, x: unit * xp.array([(x[0] / unit) ** 3]))
    problem = Complementarity(lambda xp: lambda t, x: xp.array([-unit + 0.0 * t]), (g,))
    case = Case(
        name="cubic", problem=problem, x0=np.array([0.5 * unit]), t=np.linspace(0.0, 1.0, 5)
    )
    for tol in (1e-8, 1e-13):
        assert solvers.solve(case, "event_driven", tol=tol).status.code == "degenerate"


@pytest.mark.long
@pytest.mark.parametrize("unit", (1e-4, 1e-8, 1e-10))
@pytest.mark.parametrize(
    "spec, tol, miss", (("event_driven", 1e-12, 1e-13), ("event_driven[method=rk45]", 1e-9, 1e-6))
)
def test_sliding_weights_are_the_same_in_any_unit(unit, spec, tol, miss):
    def slides(unit):
        def field(xp):
            return lambda t, x, s: (
                unit
                * xp.array(
                    [-s[0] + 0.3 * xp.cos(3.0 * t), x[0] / unit - 1.5 * s[1] + xp.sin(5.0 * t)]
                )
            )

        def switch(xp):
            return lambda t, x: xp.array([x[0], x[1] - 0.2 * unit])

        return Case(
            name="slides",
            problem=Filippov.signs(field, switch),
            x0=unit * np.array([0.5, -0.4]),
            t=np.linspace(0, 3, 7),
        )

    exact = solvers.solve(slides(1.0), "event_driven", tol=1e-12)
    run = solvers.solve(slides(unit), spec, tol=tol)
    assert run.status.ok and len(run.events) == len(exact.events) == 2
    assert (
        np.abs(run.x / unit - exact.x).max() < miss
        and np.abs(run.impulse - exact.impulse).max() < miss
    )


@pytest.mark.long
@pytest.mark.parametrize("rate", (1e4, 1e6))
@pytest.mark.parametrize(
    "spec, asked", (("event_driven", {"tol": 1e-8}), ("penalty[method=kvaerno5]", {"k": 1e3}))
)
def test_a_spring_makes_no_unit_of_how_fast_it_would_pull(rate, spec, asked):
    """x' = -rate (x - L (1 + t^2)), L = 1e-8: the target moves by L; a start left standing would be
    pulled there fast."""
    length = 1e-8
    drift = lambda xp: lambda t, x: xp.array([-rate * (x[0] - length * (1.0 + t * t))])
    case = Case(
        name="spring",
        problem=Complementarity(drift, (Affine(np.eye(1), np.array([-0.5 * length])),)),
        x0=np.array([length]),
        t=np.linspace(0.0, 1.0, 5),
    )
    t = case.t
    exact = length * (1.0 + t * t - 2.0 * t / rate - 2.0 / rate**2 * np.expm1(-rate * t))
    run = solvers.solve(case, spec, **asked)
    assert run.status.ok and np.abs(run.x[:, 0] - exact).max() < 1e-7 * length


@pytest.mark.parametrize(
    "later", (lambda xp, t, x: 2.0 + xp.sqrt(x[0] - t), lambda xp, t, x: 2.0 + 0.0 / (t - 0.5))
)
def test_a_drift_that_is_no_number_later_leaves_the_length_of_the_motion(later):
    """The root of a negative number is none; a division of floats by zero raises, in the middle of
    the run."""
    problem = Complementarity(
        lambda xp: lambda t, x: xp.array([later(xp, t, x)]), (Affine(np.eye(1), np.array([1e-5])),)
    )
    case = Case(name="later", problem=problem, x0=np.array([1e-5]), t=np.linspace(0.0, 1.0, 5))
    assert 0.5 <= case_scale(case).length <= 2.0


def test_the_unit_is_not_that_of_a_small_coordinate_that_decays_fast():
    """x' = -1e6 x from 3e-6 beside y' = 1/2 from 1e-10 below a wall: y moves by 1/2, of which that
    is a rounding."""
    drift = lambda xp: lambda t, x: xp.array([-1e6 * x[0], 0.5 + 0.0 * t])
    problem = Complementarity(drift, (Affine(np.array([[0.0, 1.0]]), np.zeros(1)),))
    case = Case(
        name="fast", problem=problem, x0=np.array([3e-6, -1e-10]), t=np.linspace(0.0, 1.0, 5)
    )
    assert 0.1 <= case_scale(case).length <= 1.0
    assert solvers.solve(case, "event_driven", tol=1e-10).status.ok


@pytest.mark.parametrize("tol", (1e-4, 1e-6, 1e-8))
@pytest.mark.parametrize("size", (1e-5, 1e-10))
def test_what_turns_comes_back_and_is_no_larger_than_its_circle(size, tol):
    """x' = 1000 y, y' = -1000 x from (0, size), stopped at x = size / 2 until y = 0: then on the
    circle of half the size."""
    w = 1000.0
    t = np.linspace(0.0, 1.0, 11)
    wall = Affine(np.array([[-1.0, 0.0]]), np.array([0.5 * size]))
    problem = Complementarity(lambda xp: lambda t, x: w * xp.array([x[1], -x[0]]), (wall,))
    case = Case(name="circle", problem=problem, x0=np.array([0.0, size]), t=t)
    leaves = (np.pi / 6.0 + np.sqrt(3.0)) / w
    exact = (
        0.5 * size * np.stack([np.cos(w * (t[1:] - leaves)), -np.sin(w * (t[1:] - leaves))], axis=1)
    )
    run = solvers.solve(case, "event_driven", tol=tol)
    assert run.status.ok and np.abs(run.x[1:] - exact).max() < tol * size


def test_a_small_coordinate_that_turns_is_no_unit_for_one_that_goes_on():
    drift = lambda xp: lambda t, x: xp.array([1e3 * x[1], -1e3 * x[0], 0.5 + 0.0 * t])
    case = Case(
        name="both",
        problem=Complementarity(drift, ()),
        x0=np.array([0.0, 1e-6, 0.0]),
        t=np.linspace(0.0, 1.0, 5),
    )
    assert 0.1 <= case_scale(case).length <= 1.0


@pytest.mark.parametrize(
    "rate, way", ((1e4, np.inf), (3.0, (np.exp(3.0) - 1.0)), (-50.0, 1.0), (0.0, 1e-300))
)
def test_a_motion_beside_the_start_is_as_long_as_it_grows(rate, way):
    x0 = np.array([1.0])
    drift = lambda x: rate * x + (1e-300 if rate == 0.0 else 0.0)
    with np.errstate(all="ignore"):
        found = _krylov(drift, x0, drift(x0), np.ones(1), 1.0)
    assert found[0] == pytest.approx(way, rel=1e-6)


@pytest.mark.parametrize("start", [1e-16, 1e-12, 1e-9, 1e-5])
@pytest.mark.parametrize(
    "spec, accuracy, near",
    [("event_driven", {"tol": 1e-12}, 1e-10), ("euler[implicit=true]", {"h": 0.01}, 1e-6)],
)
def test_a_start_that_is_next_to_nothing_is_no_size(spec, accuracy, near, start):
    """A block on a belt, v' = -x - 0.6 s: its first displacement is that of the speed at the start,
    which is rounding, and not of the motion."""
    field = lambda xp: lambda t, x, s: xp.array([x[1], -x[0] - 0.6 * s[0]])
    problem = Filippov.signs(field, lambda xp: lambda t, x: x[1:2] - 0.5)
    times = np.linspace(0.0, 10.0, 51)
    cases = [Case("block", problem, np.array([-1.0, v]), times) for v in (0.0, start)]
    runs = [solvers.solve(case, spec, **accuracy) for case in cases]
    assert [r.status.code for r in runs] == ["ok", "ok"]
    assert np.abs(runs[1].x - runs[0].x).max() <= near + 10.0 * start


def test_a_linearised_motion_that_overflows_is_no_size():
    """x' = 2e6 x - 1e4 s is held at 0 by its relay; without it x would be exp(2e6) at the end."""
    field = lambda xp: lambda t, x, s: xp.stack((2e6 * x[0] - 1e4 * s[0], 1e6 * x[0]))
    problem = Filippov.signs(field, lambda xp: lambda t, x: x[0:1])
    case = Case("relay", problem, np.array([1e-3, 0.0]), np.linspace(0.0, 1.0, 11))
    assert np.all(case_scale(case).state < 0.1)


def stribeck(start, slip=0.5):
    """A mass on a spring on a belt: friction falls with the speed of slip, and each mode grows like
    exp(60) where it does not act."""

    def mode(side):
        def factory(xp):
            def field(t, x):
                friction = 0.4 + 0.6 * xp.exp(-side * (x[1] - 0.3) / slip)
                return xp.array([x[1], -x[0] - 0.05 * x[1] - side * friction])

            return field

        return factory

    switch = lambda xp: lambda t, x: x[1:2] - 0.3
    problem = Filippov({+1: mode(1.0), -1: mode(-1.0)}, switch)
    return Case("stribeck", problem, np.array(start), np.linspace(0.0, 20.0, 41))


@pytest.mark.parametrize("start", [(0.0, 0.0), (1e-3, 0.0), (0.5, 0.0), (1.0, 0.0)])
def test_a_mode_that_explodes_where_it_never_acts_does_not_set_the_units(start):
    case = stribeck(start)
    scale = case_scale(case)
    assert 0.01 < scale.state.max() < 100.0 and 0.01 < scale.time
    run = solvers.solve(case, "event_driven")
    assert run.status.ok and run.stats["loop"] == "compiled"
    implicit = solvers.solve(case, "euler[implicit=true]", h=5e-3)
    assert implicit.status.ok and np.abs(implicit.x - run.x).max() < 0.1
