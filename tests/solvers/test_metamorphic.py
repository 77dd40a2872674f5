"""What a unit, an origin, a bystander or the end of a run cannot change, is not changed.

The whole study, over all cases and methods, is tests/studies/metamorphic.py.
"""

import changed_cases
import numpy as np
import pytest

from nsbench import Affine, Case, Complementarity, Filippov, solve
from nsbench.case import get_case
from nsbench.solvers import get

TWOS = {"time": 2.0**-30, "length": 2.0**20}
EXACT = ("event_driven", "pbd", "catching_up", "theta", "euler", "euler[implicit=true]", "penalty")
CASES = ("slide_exit", "three_discs", "rlc_diode", "crossing")
OF_EACH = [(c, m) for c in CASES for m in EXACT if get(m).refuses(get_case(c)) is None]


@pytest.mark.long
@pytest.mark.parametrize("name, spec", OF_EACH)
def test_units_that_are_powers_of_two_change_no_bit(name, spec):
    case = get_case(name)
    found = changed_cases.differences(case, spec, changed_cases.units(case, **TWOS))
    assert set(found.values()) <= {0.0}, found


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("time, length", ((1e-15, 1e15), (1e12, 1e-18)))
def test_powers_of_ten_round_only(name, time, length):
    case = get_case(name)
    found = changed_cases.differences(case, "event_driven", changed_cases.units(case, time, length))
    assert max(found.values()) <= 1e-12, found


def relay(n=2):
    """Two coupled coordinates under a relay, with crossings and a sliding arc."""

    def field(xp):
        return lambda t, x, s: xp.stack((x[1] - 0.3 * s[0], xp.cos(2.0 * t) - x[0] - 0.8 * s[0]))

    problem = Filippov.signs(field, lambda xp: lambda t, x: x[1:2] + 0.4 * x[0:1])
    return Case("relay", problem, [0.7, 0.5], np.linspace(0.0, 4.0, 17))


TURN = np.array([[0.6, -0.8], [0.8, 0.6]])
RELATIONS = {
    "unit of the switch": lambda c: changed_cases.units(c, gap=2.0**40),
    "each coordinate has its unit": lambda c: changed_cases.units(c, length=np.array([1e9, 1e-9])),
    "clock k times as fast": lambda c: changed_cases.units(c, time=0.1),
    "start of the clock": lambda c: changed_cases.units(c, origin=-3.0),
    "place": lambda c: changed_cases.moved(c, np.eye(2), [3.0, -2.0]),
    "permutation": lambda c: changed_cases.moved(c, np.eye(2)[::-1], 0.0),
    "rotation": lambda c: changed_cases.moved(c, TURN, 0.0),
    "bystander": lambda c: changed_cases.beside(c, 1e8),
    "longer horizon": lambda c: changed_cases.longer(c, 1.5),
}
TIMED = {"start of the clock"}  # of a drift that depends on time: times round


@pytest.mark.parametrize("relation", RELATIONS)
def test_what_cannot_matter_does_not(relation):
    case = relay()
    found = changed_cases.differences(case, "event_driven", RELATIONS[relation](case))
    assert max(found.values()) <= 1e-11, found


@pytest.mark.long
@pytest.mark.parametrize("gap", (2.0**40, 2.0**-40))
@pytest.mark.parametrize(
    "name, spec", (("circle_sliding", "event_driven"), ("slide_exit", "euler[implicit=true]"))
)
def test_the_unit_of_a_switch_changes_no_bit(name, spec, gap):
    case = get_case(name)
    found = changed_cases.differences(case, spec, changed_cases.units(case, gap=gap))
    assert set(found.values()) == {0.0}, found


@pytest.mark.long
@pytest.mark.parametrize("gap", (2.0**40, 2.0**-40))
@pytest.mark.parametrize("spec", ("event_driven", "pbd", "catching_up", "theta"))
@pytest.mark.parametrize("name", ("wedge", "rods_wall"))
def test_the_unit_of_a_constraint_changes_no_bit(name, spec, gap):
    case = get_case(name)
    found = changed_cases.differences(case, spec, changed_cases.units(case, gap=gap))
    assert set(found.values()) == {0.0}, found


# each: coordinates y = M x + shift, and the results that have the same names and directions there
DISCS = {
    "place": (np.eye(6), [3.0, -2.0] * 3, {"x", "impulse", "reaction", "events"}),
    "rotation": (np.kron(np.eye(3), TURN), 0.0, {"x", "impulse", "events"}),
    "labels": (np.kron(np.eye(3)[[1, 2, 0]], np.eye(2)), 0.0, {"x"}),
}


@pytest.mark.long
@pytest.mark.parametrize("relation", DISCS)
def test_discs_do_not_depend_on_place_direction_and_labels(relation):
    M, shift, same = DISCS[relation]
    case = get_case("three_discs")
    found = changed_cases.differences(case, "event_driven", changed_cases.moved(case, M, shift))
    assert max(found[k] for k in same) <= 1e-11, found


@pytest.mark.long
@pytest.mark.parametrize(
    "labels, spec, other",
    (
        ([2, 1, 0], "pbd", "pbd[order=reverse]"),
        ([1, 2, 0], "pbd[order=cell]", "pbd[order=cell]"),
    ),
)
def test_labels_change_no_bit_where_the_sweep_has_the_same_order(labels, spec, other):
    """Three discs numbered backwards are swept backwards; cells of the start know no labels."""
    case = get_case("three_discs")
    changed = changed_cases.moved(case, np.kron(np.eye(3)[labels], np.eye(2)), 0.0)
    whole = solve(changed_cases.units(case).case, spec, h=0.01)
    run = solve(changed.case, other, h=0.01)
    of_old = {(0, i, j): (0, *sorted((labels[i], labels[j]))) for _, i, j in run.contacts}
    assert np.array_equal(changed.back(run.x), whole.x)
    assert {of_old[c] for c in run.contacts} == set(whole.contacts)
    for k, c in enumerate(run.contacts):
        assert np.array_equal(run.impulse[:, k], whole.impulse[:, whole.contacts.index(of_old[c])])


@pytest.mark.long
def test_a_doubled_constraint_gives_the_same_reaction():
    case = get_case("apple")
    for spec in ("event_driven", "catching_up", "theta", "pbd"):
        found = changed_cases.differences(case, spec, changed_cases.doubled(case))
        assert max(found["x"], found["reaction"]) <= 1e-12, (spec, found)


def test_a_run_in_two_parts_is_the_run():
    case = relay()
    whole = solve(case, "event_driven")
    first = solve(case.replace(t=case.t[:9]), "event_driven")
    second = solve(case.replace(t=case.t[8:], x0=first.x[-1]), "event_driven")
    assert np.abs(np.vstack([first.x, second.x[1:]]) - whole.x).max() <= 1e-11


@pytest.mark.parametrize("u", (1.0, 1e-12, 1e-13))
def test_two_crossings_in_picomoles(u):
    """x' = u (1 - (1 + s1) / 4 - (1 + s2) / 5), met at u and 1.2 u: x(3) = 1.36 u."""

    def field(xp):
        return lambda t, x, s: xp.stack([u * (1.0 - (1.0 + s[0]) / 4.0 - (1.0 + s[1]) / 5.0)])

    problem = Filippov.signs(field, lambda xp: lambda t, x: xp.stack((x[0] - u, x[0] - 1.2 * u)))
    run = solve(Case("gene", problem, [0.0], np.linspace(0.0, 3.0, 31)), "event_driven")
    assert run.status.ok and abs(run.x[-1, 0] / u - 1.36) < 1e-12
    np.testing.assert_allclose([e.t for e in run.events], [1.0, 1.4], atol=1e-12)


@pytest.mark.parametrize("T", (1.0, 1e-9, 1e-10))
def test_a_relay_in_nanoseconds(T):
    def field(xp):
        return lambda t, x, s: xp.stack([(0.8 - 0.8 * xp.cos(2.0 * np.pi * t / T) - s[0]) / T])

    problem = Filippov.signs(field, lambda xp: lambda t, x: x)
    run = solve(Case("fast", problem, [0.1], np.linspace(0.0, 3.0 * T, 31)), "event_driven")
    assert run.status.ok and len(run.events) == 7


@pytest.mark.parametrize("end", (10.0, 1e6, 1e7, 1e9))
def test_what_happens_early_does_not_depend_on_the_end(end):
    def field(xp):
        return lambda t, x, s: xp.stack(
            [3.0 * xp.exp(-t / 2.0) * xp.sin(5.0 * t) + 0.2 * xp.exp(-t) - s[0]]
        )

    problem = Filippov.signs(field, lambda xp: lambda t, x: x)
    t = [0.0, 10.0, end] if end > 10.0 else [0.0, 10.0]
    run = solve(Case("late", problem, [0.3], np.array(t)), "event_driven")
    early = (0.9825202652, 1.244947217, 1.394557649, 1.892358333)
    assert run.status.ok
    np.testing.assert_allclose([e.t for e in run.events], early, atol=1e-9)


@pytest.mark.long
@pytest.mark.parametrize("a, b", ((1.0, 1e-6), (1e8, 1e-6), (1e6, 1.0)))
def test_coordinates_of_different_size_are_as_accurate_each(a, b):
    """Two relays beside each other, one in volts and one in coulombs."""

    def case(a, b):
        def field(xp):
            return lambda t, x, s: xp.stack(
                (a * (0.5 * xp.cos(3.0 * t) - s[0]), b * (0.5 * xp.sin(2.0 * t) - s[1]))
            )

        problem = Filippov.signs(field, lambda xp: lambda t, x: x + 0.0)
        return Case("both", problem, [0.4 * a, -0.3 * b], np.linspace(0.0, 3.0, 31))

    one = solve(case(1.0, 1.0), "event_driven")
    run = solve(case(a, b), "event_driven")
    assert run.status.ok and len(run.events) == len(one.events)
    assert np.abs(run.x / [a, b] - one.x).max() < 1e-13


def test_a_ramp_that_falls_back_is_crossed():
    """Pulse-width modulation: on while a ramp of period 1 is below 1/2; x decays to the input."""

    def field(xp):
        return lambda t, x, s: -x + 0.5 * (1.0 + s)

    problem = Filippov.signs(field, lambda xp: lambda t, x: xp.stack([0.5 - (t - xp.floor(t))]))
    run = solve(Case("pwm", problem, [0.2], np.linspace(0.0, 4.0, 9)), "event_driven")
    x = [0.2]
    for k in range(8):
        target = 1.0 if k % 2 == 0 else 0.0
        x.append(target + (x[-1] - target) * np.exp(-0.5))
    assert run.status.ok and np.abs(run.x[:, 0] - x).max() < 1e-10
    np.testing.assert_allclose([e.t for e in run.events][:7], np.arange(0.5, 4.0, 0.5), atol=1e-12)


def test_a_stated_scale_is_used():
    drift = lambda xp: lambda t, x: -x
    problem = Complementarity(drift, (Affine(np.eye(1), [0.0]),))
    case = Case("stated", problem, [1.0], np.linspace(0.0, 1.0, 3))
    from nsbench.case.scale import Scale
    from nsbench.dynamics.scaling.scaled_case import scaled_case

    own = scaled_case(case.replace(scale=Scale(4.0, 8.0)))
    assert (own.time, own.state[0], own.case.x0[0], own.case.t[-1]) == (4.0, 8.0, 0.125, 0.25)


@pytest.mark.parametrize("name", ("slide_exit", "stick_slip", "three_discs"))
def test_a_clock_that_shows_late_times_rounds_only(name):
    """Inputs are known to roundings of the time, 2e-12 at 1e4, wherever the run's own time
    begins."""
    case = get_case(name)
    late = changed_cases.units(case, origin=1e4 * case.t[-1])
    found = changed_cases.differences(case, "event_driven", late)
    assert max(found.values()) <= 1e-9, found


@pytest.mark.parametrize("gap", (2.0**10, 2.0**-10))
def test_a_penalty_takes_a_constraint_in_any_unit(gap):
    case = get_case("apple")
    run = solve(changed_cases.units(case, gap=gap).case, "penalty")
    plain = solve(case, "penalty")
    assert run.status.ok and np.abs(run.x - plain.x).max() < 1e-3
