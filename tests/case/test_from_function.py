"""Cases from a function as written for solve_ivp: its jumps are known from its values alone."""

import warnings

import numpy as np
import pytest

import nsbench
from nsbench import Complementarity, Filippov, errors, from_function, solve
from nsbench.case.plain_function import OneSidedFields

pytestmark = pytest.mark.filterwarnings("ignore:runs of")
T = np.linspace(0.0, 2.0, 21)
FIRST = 0.6912502895937311  # zero of 1/2 - t + 0.3 sin t


def forced(t, y):
    return np.array([-np.sign(y[0]) + 0.3 * np.cos(t)])


def forced_exact(t):
    t = np.asarray(t)
    return np.where(t < FIRST, 0.5 - t + 0.3 * np.sin(t), 0.0)[:, None]


def forced_weight(t):
    """Integral of theta, (1 + s) / 2 with s = 0.3 cos t while sliding."""
    slid = 0.5 * (t - FIRST) + 0.15 * (np.sin(t) - np.sin(FIRST))
    return np.where(t < FIRST, t, FIRST + slid)[:, None]


CASE = dict(exact=forced_exact, exact_impulse=forced_weight, exact_events=[FIRST])


@pytest.mark.long
def test_a_sign_inside_the_function_slides():
    case = from_function(forced, lambda t, y: y[0], [0.5], T, **CASE)
    traj = solve(case, "event_driven")
    found = errors(case, traj)
    assert traj.status.ok and isinstance(case.problem, Filippov)
    assert [(e.kind, e.contact) for e in traj.events] == [("enter", (0, 0))]
    assert found["state_sup"] < 1e-12 and found["impulse"] < 1e-12 and found["event_time"] < 1e-13
    assert found["residual"] < 1e-10


def test_steps_of_euler_are_of_order_one():
    case = from_function(forced, [lambda t, y: y[0]], [0.5], T, **CASE)
    for spec in ("euler", "euler[implicit=true]"):
        runs = [errors(case, solve(case, spec, h=h)) for h in (0.02, 0.005)]
        assert runs[1]["state_sup"] < 0.5 * runs[0]["state_sup"] < 0.02


@pytest.mark.long
def test_dry_friction_is_that_of_a_field_with_signs():
    def f(t, y):
        x, v = y
        return [v, -x - 0.3 * np.sign(v) + 0.1 * np.sin(2.0 * t) * (v > 0.0)]

    def field(xp):
        return lambda t, x, s: xp.array(
            [x[1], -x[0] - 0.3 * s[0] + 0.05 * xp.sin(2.0 * t) * (1.0 + s[0])]
        )

    t = np.linspace(0.0, 7.5, 16)
    plain = solve(from_function(f, lambda t, y: y[1], [1.3, 0.0], t), "event_driven")
    other = nsbench.Case(
        "friction",
        Filippov.signs(field, lambda xp: lambda t, x: x[1:2]),
        np.array([1.3, 0.0]),
        t,
    )
    expected = solve(other, "event_driven")
    assert plain.status.ok and [e.kind for e in plain.events] == [e.kind for e in expected.events]
    assert "enter" in [e.kind for e in plain.events]
    assert np.abs(plain.x - expected.x).max() < 1e-11


@pytest.mark.long
def test_a_curved_surface_and_a_surface_in_time_are_left_to_both_sides():
    """Slides on the circle r = 1, round which it turns, forced by a relay in time."""

    def f(t, y):
        r = np.hypot(*y)
        pull = -np.sign(r - 1.0) + 0.25 * np.sign(np.sin(2.0 * t + 0.3))
        return np.array([pull * y[0] / r - y[1], pull * y[1] / r + y[0]])

    surfaces = [lambda t, y: y[0] ** 2 + y[1] ** 2 - 1.0, lambda t, y: np.sin(2.0 * t + 0.3)]
    traj = solve(from_function(f, surfaces, [1.5, 0.0], np.linspace(0.0, 1.6, 9)), "event_driven")
    entered = 0.5 / 0.75
    late = traj.t > entered
    exact = np.column_stack([np.cos(traj.t), np.sin(traj.t)])
    radius = np.where(late, 1.0, 1.5 - 0.75 * traj.t)[:, None]
    assert traj.status.ok and np.abs(traj.x - radius * exact).max() < 1e-10


def test_the_field_of_a_side_is_that_of_its_own_points():
    """On the surface: the limit; beyond: a continuation without a jump or a kink."""

    def f(t, y):
        return np.array([np.exp(y[0]) if y[0] > 0.0 else -np.cos(y[0])])

    sides = OneSidedFields(f, [lambda t, y: y[0]], np.array([1.0]), T)
    at = lambda x, s: sides.value(0.0, np.array([x]), np.array([s])).item()
    assert at(0.3, 1.0) == np.exp(0.3) and at(-0.3, -1.0) == -np.cos(0.3)
    assert abs(at(0.0, 1.0) - 1.0) < 1e-13 and abs(at(0.0, -1.0) + 1.0) < 1e-13
    for x in (1e-12, 1e-8, 1e-6, 1e-3):
        assert abs(at(-x, 1.0) - (1.0 - x)) <= x**2 + 1e-13
        assert abs(at(x, -1.0) + 1.0) <= x**2 + 1e-13


def test_without_surfaces_it_is_a_smooth_equation_and_may_be_compiled():
    case = from_function(lambda t, y: -y, None, [1.0, 2.0], T)
    assert case.problem.constraints == () and isinstance(case.problem, Complementarity)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        from_function(lambda t, y: -y, (), [1.0, 2.0], T)
    traj = solve(case, "event_driven")
    assert np.abs(traj.x - np.exp(-T)[:, None] * [1.0, 2.0]).max() < 1e-11
    assert solve(case, "euler", h=0.01).stats["loop"] == "compiled"


def test_a_function_that_returns_a_list_runs_too():
    case = from_function(lambda t, y: [y[1], -y[0]], None, [0.0, 1.0], T)
    traj = solve(case, "event_driven")
    assert np.abs(traj.x[:, 0] - np.sin(T)).max() < 1e-11
    assert solve(case, "euler", h=0.01).stats["loop"] == "host"


@pytest.mark.filterwarnings("default:runs of")
@pytest.mark.parametrize(
    "f, surfaces, word",
    ((forced, lambda t, y: y[0], "not traced"), (lambda t, y: [-y[0]], None, "no array")),
)
def test_the_slow_path_is_said(f, surfaces, word):
    with pytest.warns(UserWarning, match=word):
        from_function(f, surfaces, [0.5], T)


@pytest.mark.long
def test_units_do_not_matter():
    scaled = lambda t, y: 1e-6 * forced(t / 1e3, y) / 1e3
    case = from_function(scaled, lambda t, y: y[0], [0.5e-6], 1e3 * T)
    traj = solve(case, "event_driven")
    assert traj.status.ok and np.abs(traj.x * 1e6 - forced_exact(T)).max() < 1e-11


@pytest.mark.parametrize(
    "arguments, words",
    (
        ((3.0, None, [0.5], T), "a function f(t, y) is needed"),
        ((forced, [3.0], [0.5], T), "surface 0 is 3.0"),
        ((forced, [forced] * 9, [0.5], T), "at most 8"),
        ((lambda t, y: np.zeros(2), None, [0.5], T), "float64 (1,) is needed"),
    ),
)
def test_arguments_that_do_not_fit_are_named(arguments, words):
    with pytest.raises((TypeError, ValueError)) as e:
        from_function(*arguments)
    assert words in str(e.value)


def test_methods_that_trace_refuse_it():
    traj = solve(from_function(forced, lambda t, y: y[0], [0.5], T), "penalty")
    assert traj.status.code == "refused" and "array namespace" in str(traj.status)


@pytest.mark.parametrize(
    "last",
    ["CASE = from_function(f, None, [1.0], [0.0, 1.0]{})"]
    + ["def make(): return from_function(f, None, [1.0], [0.0, 1.0]{})"],
    ids=["CASE", "make"],
)
def test_a_case_without_a_name_has_that_of_its_file(tmp_path, last):
    head = "from nsbench import from_function\ndef f(t, y): return -y\n"
    for file, given, name in (
        ("falling", "", "falling"),
        ("to rest, übel", "", "to_rest___bel"),
        ("falling", ", name='given'", "given"),
        ("falling", ", name='function'", "function"),
    ):
        path = tmp_path / f"{file}.py"
        path.write_text(head + last.format(given) + "\n", encoding="utf-8")
        assert nsbench.load_case(path).name == name
    assert from_function(lambda t, y: -y, None, [1.0], T).name == "function"
