"""States at rest on a surface, beside one, or within its layer: what decides nothing is told."""

from pathlib import Path

import numpy as np
import pytest
from event_scenes import relays

from nsbench import Case, Filippov, solvers


@pytest.mark.survives("repulsive")
@pytest.mark.parametrize("samples", (2, 5, 102))
def test_a_surface_that_turns_repulsive(samples):
    """x' = (t - b) s on the surface x = 0: held before b, then left by both fields."""

    def made(b):
        def field(xp):
            return lambda t, x, s: xp.array([(t - b) * s[0], 1.0 + 0.0 * x[0]])

        def switch(xp):
            return lambda t, x: xp.array([x[0]])

        return Case(
            name="turns",
            problem=Filippov.signs(field, switch),
            x0=np.array([0.0, 0.0]),
            t=np.linspace(0, 1, samples),
        )

    status = solvers.solve(made(0.6), "event_driven", tol=1e-10).status
    assert status.code == "degenerate" and "both fields leave" in str(status)
    assert solvers.solve(made(1.5), "event_driven", tol=1e-10).status.ok
    assert solvers.solve(made(0.6).replace(unique=False), "event_driven", tol=1e-10).status.ok


@pytest.mark.long
@pytest.mark.survives("repulsive")
@pytest.mark.parametrize("side", (1.0, -1.0))
@pytest.mark.parametrize("samples", (3, 102))
def test_a_rest_on_a_surface_that_the_other_side_begins_to_leave(side, samples):
    """x' = -x on one side, which is at rest on x = 0, and (b - t) towards it on the other: from t =
    b on the state may leave."""

    def made(b, rest=-1.0):
        def field(xp):
            return lambda t, x, s: xp.array(
                [xp.where(s[0] * side > 0.0, rest * x[0], side * (b - t))]
            )

        return Case(
            name="rests",
            problem=Filippov.signs(field, lambda xp: lambda t, x: xp.array([x[0]])),
            x0=np.array([-0.1 * side]),
            t=np.linspace(0.0, 1.0, samples),
        )

    status = solvers.solve(made(0.6), "event_driven", tol=1e-10).status
    assert status.code == "degenerate" and "at rest" in str(status)
    assert solvers.solve(made(1.5), "event_driven", tol=1e-10).status.ok
    assert solvers.solve(made(0.6).replace(unique=False), "event_driven", tol=1e-10).status.ok


def test_what_comes_to_rest_beside_a_surface_has_not_met_it():
    """x' = -x from 1 to exp(-20), with a side below that leads away from x = 0, which the state
    never sees."""
    case = relays(
        lambda xp: lambda t, x, s: xp.array([xp.where(s[0] > 0.0, -x[0], -1.0)]),
        lambda xp: lambda t, x: xp.array([x[0]]),
        [1.0],
        np.linspace(0.0, 20.0, 11),
    )
    traj = solvers.solve(case, "euler[implicit=true]", h=1e-3)
    assert traj.status.ok and traj.x[-1, 0] == pytest.approx(np.exp(-20.0), rel=0.02)


@pytest.mark.parametrize("spec", ("event_driven", "euler[implicit=true]"))
@pytest.mark.parametrize("beside, code", ((1e-11, "ok"), (0.0, "degenerate")))
def test_a_surface_is_no_thicker_for_a_large_coordinate(spec, beside, code):
    """(x, y)' = (1, 0) where y > 0, (1, -1) below, from (1e4, y): beside the surface y = 0, along
    it; on it, it may leave."""
    case = relays(
        lambda xp: lambda t, x, s: xp.array([1.0, 0.5 * (s[0] - 1.0)]),
        lambda xp: lambda t, x: xp.array([x[1]]),
        [1e4, beside],
        np.linspace(0.0, 1.0, 5),
    )
    assert (
        solvers.solve(
            case, spec, **({"tol": 1e-10} if spec == "event_driven" else {"h": 0.01})
        ).status.code
        == code
    )


@pytest.mark.parametrize("power, code", ((1, "ok"), (3, "unverified")))
def test_a_layer_is_flat_where_its_slope_changes_within(power, code):
    """Onto the circle r = 1 from r = 20: the slope of r^2 - 1 falls from 40 to 2, which is a length
    like another; that of its third power vanishes there, and the layer of a penalty is k^(-1/3)
    wide."""

    def field(xp):
        return lambda t, x, s: (
            -10.0 * s[0] * x / xp.sqrt(x[0] * x[0] + x[1] * x[1]) + xp.array([0.0 * t, 0.0 * t])
        )

    def switch(xp):
        return lambda t, x: xp.array([(x[0] * x[0] + x[1] * x[1] - 1.0) ** power])

    case = Case(
        name="circle",
        problem=Filippov.signs(field, switch),
        x0=np.array([12.0, 16.0]),
        t=np.linspace(0.0, 2.5, 6),
    )
    assert solvers.solve(case, "penalty", k=300.0).status.code == code


@pytest.mark.parametrize("power, code", ((1, "ok"), (3, "unverified")))
def test_a_flat_layer_between_two_samples_is_seen(power, code):
    """On the surface from t = 0.2 to 0.75 (where 3 t^2 - 0.5 = 1.2), and away from it at both
    samples."""
    case = relays(
        lambda xp: lambda t, x, s: xp.array([3.0 * t * t - 0.5 - 1.2 * s[0]]),
        lambda xp: lambda t, x: xp.array([x[0] ** power]),
        [0.3],
        [0.0, 1.0],
    )
    run = solvers.solve(case, "penalty", k=3e3)
    assert run.status.code == code and run.x.shape == (2, 1)
    assert power > 1 or run.x[-1, 0] == pytest.approx(
        (1.0 - 1.7) - (t := np.sqrt(1.7 / 3.0)) ** 3 + 1.7 * t, abs=1e-3
    )


@pytest.mark.parametrize("second", (2.0, -1.0))
def test_a_surface_of_two_switches_that_all_fields_leave_is_told(second):
    """From t = 0.457 on; until then the state is held on it."""
    case = relays(
        lambda xp: lambda t, x, s: xp.array([(2.0 * t - 0.9137) * s[0]]),
        lambda xp: lambda t, x: xp.array([x[0], second * x[0]]),
        [0.1],
        np.linspace(0.0, 1.0, 21),
    )
    status = solvers.solve(case, "event_driven").status
    assert status.code == "degenerate" and "surfaces 0, 1" in str(status)
    assert solvers.solve(case.replace(t=np.linspace(0.0, 0.45, 21)), "event_driven").status.ok


@pytest.mark.parametrize(
    "rows, power", (([1.0], 1), ([1.0], 3), ([1.0, -2.0], 1), ([1.0, -2.0], 3))
)
@pytest.mark.parametrize("end, code", ((0.45, "ok"), (1.0, "degenerate")))
def test_a_surface_that_is_come_to_between_two_samples_is_looked_at(rows, power, end, code):
    case = relays(
        lambda xp: lambda t, x, s: xp.array([(2.0 * t - 0.9137) * s[0]]),
        lambda xp: lambda t, x: xp.array([r * x[0] ** power for r in rows]),
        [0.1],
        [0.0, end],
    )
    run = solvers.solve(case, "event_driven")
    assert run.status.code == code and abs(run.x[-1, 0]) < 1e-15


def test_a_layer_that_holds_a_repelled_start_is_told():
    from nsbench import load_case

    case = load_case(Path(__file__).parents[1] / "regressions" / "start_in_a_repulsive_layer.py")
    status = solvers.solve(case, "penalty", k=1e3).status
    assert status.code == "unverified" and "both fields leave" in str(status)
    assert solvers.solve(case.replace(x0=np.array([0.1])), "penalty", k=1e3).status.ok


@pytest.mark.parametrize("scale, code", ((1.0, "ok"), (1e-3, "unverified")))
def test_a_layer_that_one_of_two_switches_does_not_leave_is_told(scale, code):
    case = relays(
        lambda xp: lambda t, x, s: xp.array([1.0 - 0.5 * s[0], 0.3 - 0.5 * s[1]]),
        lambda xp: lambda t, x: xp.array([x[0] + 0.2, scale * (x[1] - 0.1)]),
        [-0.5, 0.5],
        np.linspace(0.0, 1.0, 6),
    )
    status = solvers.solve(case, "penalty", k=100.0).status
    assert status.code == code and (code == "ok" or "Switch 1" in str(status))
    far = case.replace(
        x0=np.array([-0.5, 100.0])
    )  # 0.1 from its surface: with another sign it is never seen
    assert solvers.solve(far, "penalty", k=100.0).status.ok


def test_a_layer_of_a_switch_that_no_field_asks_is_none():
    case = relays(
        lambda xp: lambda t, x, s: xp.array([0.3 - s[0], 0.5]),
        lambda xp: lambda t, x: xp.array([x[0], 1e-5 * (x[1] - 0.5)]),
        [0.5, 0.0],
        np.linspace(0.0, 1.0, 6),
    )
    assert solvers.solve(case, "penalty", k=1e3).status.ok


@pytest.mark.parametrize(
    "field, exact",
    (
        (lambda xp, t, s: 1.0 + 2.0 * xp.sin(np.pi * t) ** 2 * s, 0.0),
        (lambda xp, t, s: 1.0 + xp.where((t > 0.2) & (t < 0.8), s, 0.0), 0.4),
    ),
    ids=("between samples", "for a while"),
)
def test_a_layer_is_one_where_a_field_asks_its_switch_between_samples(field, exact):
    case = relays(
        lambda xp: lambda t, x, s: xp.array([field(xp, t, s[0])]),
        lambda xp: lambda t, x: xp.array([1e-5 * (x[0] - 5.0)]),
        [0.0],
        [0.0, 1.0],
    )
    status = solvers.solve(case, "penalty", k=1e3).status
    assert status.code == "unverified" and "Switch 0" in str(status)
    run = solvers.solve(case, "euler", h=1e-3)
    assert run.status.ok and run.x[-1, 0] == pytest.approx(exact, abs=3e-3)


@pytest.mark.parametrize("height", (0.0, 1.0, 3.0))
@pytest.mark.parametrize("fall", (1.0, 0.7))
def test_a_fall_onto_a_surface_ends_on_it_wherever_it_lies(height, fall):
    """y' = -2 fall (1 - t) above the surface until t = 1, then 0; -1 below: from t = 1 on the state
    may leave."""
    case = relays(
        lambda xp: (
            lambda t, x, s: xp.array(
                [xp.where(s[0] > 0.0, -2.0 * fall * xp.maximum(1.0 - t, 0.0), -1.0)]
            )
        ),
        lambda xp: lambda t, x: xp.array([x[0] - height]),
        [height + fall],
        np.linspace(0.0, 2.0, 9),
    )
    status = solvers.solve(case, "event_driven", tol=1e-10).status
    assert status.code == "degenerate" and "at rest" in str(status)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("spec, code", (("euler", "degenerate"), ("euler[implicit=true]", "ok")))
def test_a_switch_that_raises_beside_the_state_is_no_crash(spec, code):
    """A table that ends at x = 1, where the state stays."""

    def switch(xp):
        if xp is not np:
            return lambda t, x: xp.array([x[1]])

        def f(t, x):
            if x[0] > 1.0:
                raise ValueError("the table ends")
            return np.array([x[1]])

        return f

    case = relays(
        lambda xp: lambda t, x, s: xp.array([0.0 * t, 0.5 * (s[0] - 1.0)]),
        switch,
        [1.0, 0.0],
        np.linspace(0, 1, 5),
    )
    assert solvers.solve(case, spec, h=0.01).status.code == code


def test_a_corner_beside_which_a_field_is_no_number_is_told():
    """Along y = 0 to x = 0 at t = 1/2, behind which one of the fields is the root of a negative
    number."""

    def mode(x, y):
        return lambda xp: lambda t, z: xp.array([x + 0.0 * t, y + 0.0 * t])

    fields = {
        (1, 1): mode(-1.0, -1.0),
        (1, -1): mode(-1.0, 1.0),
        (-1, -1): mode(-1.0, 1.0),
        (-1, 1): lambda xp: lambda t, z: xp.array([-1.0 + 0.0 * t, -xp.sqrt(0.1 - t)]),
    }
    case = Case(
        name="corner",
        problem=Filippov(fields, lambda xp: lambda t, x: 1.0 * x),
        x0=np.array([0.5, 0.0]),
        t=np.linspace(0.0, 1.0, 5),
    )
    status = solvers.solve(case, "event_driven", tol=1e-10).status
    assert status.code == "nan" and "not finite" in str(status)


@pytest.mark.parametrize("spec", ("event_driven", "euler", "euler[implicit=true]"))
def test_what_decays_never_meets_the_surface(spec):
    """x' = -10 x from 1 to exp(-50), with a side below x = 0 that leads away: every digit of x is
    known all the time."""
    case = relays(
        lambda xp: lambda t, x, s: xp.array([xp.where(s[0] > 0.0, -10.0 * x[0], -1.0)]),
        lambda xp: lambda t, x: xp.array([x[0]]),
        [1.0],
        np.linspace(0.0, 5.0, 51),
    )
    run = solvers.solve(case, spec, **({"tol": 1e-10} if spec == "event_driven" else {"h": 1e-3}))
    assert run.status.ok and np.log(run.x[-1, 0]) == pytest.approx(-50.0, abs=0.3)


def test_a_field_that_is_no_number_on_the_straight_ways_asks_no_switch():
    """Along a circle in quarters, inside of which a root is of a negative number; the second switch
    is in its layer."""

    def field(xp):
        def f(t, x, s):
            w = xp.sqrt(x[0] * x[0] + x[1] * x[1] - 0.6) / np.sqrt(0.4)
            return xp.array([-x[1] * w, x[0] * w])

        return f

    case = relays(
        field,
        lambda xp: lambda t, x: xp.array([x[0] + 3.0, 1e-5 * x[1]]),
        [1.0, 0.0],
        np.linspace(0.0, 2 * np.pi, 5),
    )
    run = solvers.solve(case, "penalty", k=1e3)
    assert run.status.ok and run.x[-1] == pytest.approx([1.0, 0.0], abs=1e-6)


def test_a_switch_that_a_field_asks_only_where_two_others_differ_is_asked():
    """x' = 1 + s0 (s1 - s2) / 2, where all three are in their layers."""
    case = relays(
        lambda xp: lambda t, x, s: xp.array([1.0 + 0.5 * s[0] * (s[1] - s[2]), 0.0 * t]),
        lambda xp: (
            lambda t, x: xp.array([1e-5 * (x[0] - 5.0), 1e-5 * (x[1] + 1.0), 1e-5 * (x[1] - 1.0)])
        ),
        [0.0, 0.0],
        [0.0, 1.0],
    )
    status = solvers.solve(case, "penalty", k=1e3).status
    assert status.code == "unverified" and "Switch 0" in str(status)
