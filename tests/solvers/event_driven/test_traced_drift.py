"""Drifts that are no A x + c run compiled too, by the Taylor series of their traced operations, and
agree with closed forms and with the loop in Python; no pulse hides in a step."""

from math import erf, pi

import numpy as np
import pytest
from studies import random_scenes as scenes

from nsbench import Affine, Case, Complementarity, Distance, Filippov, get_case
from nsbench.solvers import solve
from nsbench.solvers.event_driven.contacts.drift_program import dependences, trace_drift
from nsbench.solvers.event_driven.filippov.program import UntraceableError, trace_programs

PYTHON = "event_driven[compiled=false]"
MOVING = ("closing_box", "obstacles")
WIDTHS = [1e-1, 1e-2, 1e-3, 1e-4]


def agree(case, bound):
    """The compiled run and the one in Python, to `bound`, in state, reaction and events."""
    ours = solve(case, "event_driven")
    other = solve(case, PYTHON)
    assert ours.stats["loop"] == "compiled" and other.stats["loop"] == "host"
    assert ours.status.ok and other.status.ok
    for u, v in ((ours.x, other.x), (ours.reaction, other.reaction)):
        assert np.abs(u - v).max() <= bound * max(1.0, np.abs(v).max())
    kinds = lambda traj: sorted((e.kind, e.contact) for e in traj.events if e.kind != "pivot")
    assert kinds(ours) == kinds(other)


@pytest.mark.parametrize("name", ["tide", "duplicate", "stiff_contact", "smooth"])
def test_cases_of_the_catalogue_agree_with_python(name):
    agree(get_case(name), 1e-11)


@pytest.mark.long
@pytest.mark.parametrize("kind", [k for k in scenes.KINDS if k not in MOVING])
def test_random_scenes_in_waves_agree_with_python(kind):
    for n, seed in ((3, 1), (7, 2)):
        agree(scenes.scene(kind, n, seed), 1e-10)


def test_discs_in_a_swirl_that_depends_on_place_and_time():
    """Distances, walls and a drift with every kind of operation, which couples the coordinates."""

    def drift(xp):
        def f(t, x):
            p = x.reshape((3, 2))
            r = xp.sqrt(1.0 + p[:, 0] ** 2 + p[:, 1] ** 2)
            pull = -xp.tanh(p[:, 0]) * (1.2 + xp.sin(2.0 * t)), -xp.exp(-0.1 * r) * p[:, 1] / r
            turn = xp.arctan(p[:, 1]), xp.log(r) - 0.2 * p[:, 0]
            return xp.stack((pull[0] + 0.3 * turn[0], pull[1] + 0.3 * turn[1]), axis=1).reshape(6)

        return f

    x0 = np.array([1.4, 0.3, -0.9, 0.8, 0.2, -1.1])
    floor = Affine(np.eye(6)[1::2], np.full(3, 1.3))
    agree(
        Case("swirl", Complementarity(drift, (Distance(d=1.0), floor)), x0, np.linspace(0, 6, 13)),
        1e-10,
    )


def pulse(width, xp, t):
    """A pulse of area 2 sqrt(pi) at t = 1, written as a product of two different operations: its
    enclosures overflow."""
    z = (t - 1.0) / width
    return 2.0 * xp.exp(-z * z) / width


@pytest.mark.parametrize("width", WIDTHS)
def test_a_pulse_of_the_drift_moves_the_state_by_its_area(width):
    drift = lambda xp: lambda t, x: xp.array([0.25 + pulse(width, xp, t), 0.1 * x[0] - x[1] ** 2])
    walls = Affine(np.eye(2), np.full(2, 0.2))
    case = Case("p", Complementarity(drift, (walls,)), np.full(2, 0.5), np.array([0.0, 3.0]))
    area = pi**0.5 * (erf(2.0 / width) + erf(1.0 / width))
    for method in ("event_driven", PYTHON):
        traj = solve(case, method)
        assert traj.status.ok and abs(traj.x[-1, 0] - 1.25 - area) < 1e-11, method


@pytest.mark.parametrize("width", WIDTHS)
def test_a_pulse_of_a_mode_moves_the_state_by_its_area(width):
    drift = lambda xp: lambda t, x: xp.array([0.25 + pulse(width, xp, t)])
    switch = lambda xp: lambda t, x: x + 5.0
    problem = Filippov({(1,): drift, (-1,): drift}, switch)
    traj = solve(Case("p", problem, np.array([0.5]), np.array([0.0, 3.0])), "event_driven")
    area = pi**0.5 * (erf(2.0 / width) + erf(1.0 / width))
    assert traj.stats["loop"] == "compiled" and abs(traj.x[-1, 0] - 1.25 - area) < 1e-11


@pytest.mark.parametrize("press", [1e3, 1e7, 1e9])
def test_a_small_front_is_seen_beside_a_large_drift_that_a_wall_holds(press):
    """x_2' = a (1 + tanh((t - 5) / w)), a = 1e-12 of what presses on x_1: 10 a in all."""
    a = 1e-12 * press
    drift = lambda xp: lambda t, x: xp.array(
        [0.0 * x[0] - press, a * (1.0 + xp.tanh((t - 5.0) / 0.2))]
    )
    problem = Complementarity(drift, (Affine([[1.0, 0.0]], [0.0]),))
    traj = solve(Case("f", problem, np.zeros(2), np.linspace(0.0, 10.0, 5)), "event_driven")
    assert traj.stats["loop"] == "compiled" and traj.status.ok
    assert abs(traj.x[-1, 1] - 10.0 * a) < 1e-5 * a * 10.0


@pytest.mark.parametrize("method", ["event_driven", PYTHON])
def test_a_contact_that_closes_at_the_very_end_is_no_failure(method):
    """x' = -e^t from e - 1 closes at t = 1, the last sample."""
    drift = lambda xp: lambda t, x: 0.0 * x - xp.exp(t)
    problem = Complementarity(drift, (Affine([[1.0]], [0.0]),))
    traj = solve(Case("e", problem, np.array([np.e - 1.0]), np.array([0.0, 0.5, 1.0])), method)
    assert traj.status.ok and abs(traj.x[-1, 0]) < 1e-14


@pytest.mark.parametrize("c", [3.0, 4.0, 5.0])
def test_a_push_that_begins_within_the_tolerance_holds_no_longer_than_that(c):
    """x_2' = (t - c) / 1000 comes to its wall with a push of 0.004, which falls; x_1 was held by
    larger ones. No multiplier is below -tol |f|, and |f| <= 1 / 2: it lets go by c + 5."""
    rate = 1e-3
    drift = lambda xp: lambda t, x: xp.array([0.5 * xp.sin(1.4 * t) + 0.0 * x[0], rate * (t - c)])
    free = lambda t: 0.5 * rate * (t - c) ** 2
    x0 = np.array([0.3, free(-10.0) - 0.5 * rate * 4.0**2])
    problem = Complementarity(drift, (Affine(np.eye(2), np.zeros(2)),))
    case = Case("p", problem, x0, np.linspace(-10.0, 15.0, 6))
    traj = solve(case, "event_driven", tol=1e-2)
    assert traj.stats["loop"] == "compiled" and traj.status.ok
    assert -1e-12 <= free(15.0) - traj.x[-1, 1] <= free(c + 5.0) + 1e-12


def test_parts_of_the_state_are_what_operations_couple():
    def drift(xp):
        return lambda t, x: xp.array(
            [xp.sin(t) * x[1], x[0] / (2.0 + xp.cos(x[1])), t + 1.0, xp.exp(x[4]), 0.5 * x[3] * t]
        )

    case = Case("d", Complementarity(drift), np.ones(5), np.linspace(0.0, 1.0, 3))
    ptr, cols, vals, constant = dependences(trace_drift(case, needs_kinks=False)[0])
    rows = [cols[a:b].tolist() for a, b in zip(ptr, ptr[1:], strict=False)]
    assert rows == [[1], [0, 1], [], [4], [3]]
    assert not vals.any() and not constant.any()


@pytest.mark.parametrize(
    ("drift", "word"),
    [
        (lambda xp: lambda t, x: xp.abs(x - 0.4) - 0.1 * t, "kink"),
        (lambda xp: lambda t, x: (1j * xp.exp(1j * x)).real - 0.1 * t, "cannot be traced"),
    ],
)
def test_what_is_not_compiled_says_why(drift, word):
    case = Case(
        "n", Complementarity(drift, (Affine([[1.0]], [0.0]),)), np.ones(1), np.linspace(0, 1, 3)
    )
    note = solve(case, "event_driven").stats["note"]
    assert note.startswith("The loop ran in Python") and word in note


def test_a_state_of_too_many_coordinates_is_not_traced(monkeypatch):
    """The room for operations is less than the coordinates alone take."""
    case = get_case("discs[n=3]")
    monkeypatch.setattr("nsbench.solvers.event_driven.filippov.tracing.graph.MOST", case.n)
    traced, why = trace_drift(case, needs_kinks=False)
    assert traced is None and f"more than {case.n} operations" in why
    with pytest.raises(UntraceableError, match="operations"):
        trace_programs(get_case("sliding").problem, 1, (0.0, 1.0), np.ones(case.n))
