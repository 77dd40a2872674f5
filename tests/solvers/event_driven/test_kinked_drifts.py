"""Drifts with kinks, jumps, tables and splines: compiled, proven and exact, and no event of theirs
is one of the problem."""

import numpy as np
import pytest
from event_scenes import floor, scene
from scipy.interpolate import CubicSpline

from nsbench import Case, Filippov, load_case, solve
from nsbench.cli.file_checks.case_checks import check_case
from nsbench.report.assemble import write_case_notes
from nsbench.report.data import Data, Runs
from nsbench.study.attempt import run_one
from nsbench.study.plan import Spec

factory = lambda f: lambda xp: lambda *a: f(xp, *a)
KNOTS = np.linspace(-1.0, 1.0, 9)
SPLINE = CubicSpline(KNOTS, np.sin(3.0 * KNOTS))
TABLE = np.array([-1.0, -0.3, 0.2, 0.9]), np.array([0.0, 2.0, -1.0, 3.0])
TEETH = np.arange(9) * 0.25


def spline(xp, u):
    j = xp.searchsorted(KNOTS[1:-1], u)
    w = u - xp.take(KNOTS, j)
    value = xp.take(SPLINE.c[0], j)
    for row in (1, 2, 3):
        value = value * w + xp.take(SPLINE.c[row], j)
    return value


# g(xp, t, u) along u = t - 1, 0 <= t <= 2, and the exact integral
DRIFTS = {
    "abs": (lambda xp, t, u: xp.abs(u - 0.3), 0.5 * (1.3**2 + 0.7**2)),
    "sign": (lambda xp, t, u: xp.sign(u - 0.3) * u, 0.91),
    "clip": (lambda xp, t, u: xp.clip(2.0 * u, -0.5, 1.0), -0.375 - 0.0625 + 0.25 + 0.5),
    "where of time": (lambda xp, t, u: xp.where(t < 0.7, -1.0, 1.0), 0.6),
    "table": (lambda xp, t, u: xp.interp(u, *TABLE), np.trapezoid(TABLE[1], TABLE[0]) + 0.3),
    "spline": (lambda xp, t, u: spline(xp, u), SPLINE.integrate(-1.0, 1.0)),
    "nested": (lambda xp, t, u: xp.abs(xp.abs(u) - 0.5), 0.5),
    "logic": (
        lambda xp, t, u: xp.where((u > -0.3) & ~(u > 0.4) | (t > 1.7), 1.0, 0.0),
        1.0,
    ),
    "largest of three": (
        lambda xp, t, u: xp.max(xp.array([u, -u, 0.3 + 0.0 * u])),
        1.0 - 0.09 + 0.18,
    ),
    "heaviside": (lambda xp, t, u: xp.heaviside(u - 0.25, 0.5) + xp.minimum(u, 0.0), 0.25),
    "sawtooth": (lambda xp, t, u: xp.interp(t, TEETH, (-1.0) ** np.arange(9)), 0.0),
    "touch": (lambda xp, t, u: xp.abs(u * u), 2.0 / 3.0),
    "slow crossing": (lambda xp, t, u: xp.maximum(u**3, 0.0), 0.25),
    "products of signs": (
        lambda xp, t, u: xp.where(xp.sign(u) * xp.sign(u - 0.2) > 0.0, 1.0, 2.0),
        2.2,
    ),
}


ELEMENTARY = {
    "logarithms": (lambda xp, u: xp.log2(u) + xp.log10(u) + xp.log1p(u) + xp.expm1(u)),
    "inverse": (lambda xp, u: xp.arcsin(0.3 * u) + xp.arccos(0.4 * u)),
    "sums": (lambda xp, u: xp.cumsum(xp.array([u, u * u, 1.0 + 0.0 * u]))[1]),
}


@pytest.mark.parametrize("name", ELEMENTARY)
def test_functions_written_by_others_are_traced(name):
    f = ELEMENTARY[name]
    traj = solve(along_a_line(lambda xp, t, u: f(xp, u + 1.3)), "event_driven")
    nodes, weights = np.polynomial.legendre.leggauss(40)
    assert is_compiled_and_proven(traj)
    assert abs(traj.x[-1, 1] - weights @ [f(np, v + 1.3) for v in nodes]) < 1e-12


def smooth_surface(xp, t, x):
    return x[0:1] + 100.0


def along_a_line(g):
    """x0 = t - 1, x1' = g, with a surface that is never reached."""
    f = factory(lambda xp, t, x: xp.array([1.0 + 0.0 * t, g(xp, t, x[0]) + 0.0 * t]))
    problem = Filippov({(1,): f, (-1,): f}, factory(smooth_surface))
    return Case("line", problem, np.array([-1.0, 0.0]), np.linspace(0.0, 2.0, 6))


def is_compiled_and_proven(traj):
    return traj.status.ok and (traj.stats["loop"], traj.stats["roots"], "note" in traj.stats) == (
        "compiled",
        "verified",
        False,
    )


@pytest.mark.parametrize("name", DRIFTS)
def test_kinks_are_compiled_proven_exact_and_no_events(name):
    g, integral = DRIFTS[name]
    traj = solve(along_a_line(g), "event_driven")
    assert is_compiled_and_proven(traj) and traj.events == ()
    assert abs(traj.x[-1, 1] - integral) <= 1e-13


def signs(field, switch, x0, T=10.0):
    return Case(
        "signs",
        Filippov.signs(factory(field), factory(switch)),
        np.array(x0),
        np.linspace(0.0, T, 21),
    )


def pushed(x, t, xp):
    return 2.0 * xp.cos(1.3 * t) - x[0]


OSCILLATORS = {
    "stop spring": (
        lambda xp, t, x, s: xp.array(
            [x[1], pushed(x, t, xp) - 4.0 * xp.maximum(x[0] - 0.5, 0.0) - 0.3 * s[0]]
        ),
        lambda xp, t, x, s: xp.array(
            [x[1], pushed(x, t, xp) - 2.0 * (1.0 + s[1]) * (x[0] - 0.5) - 0.3 * s[0]]
        ),
        lambda xp, t, x: xp.array([x[1], x[0] - 0.5]),
    ),
    "drag": (
        lambda xp, t, x, s: xp.array(
            [x[1], pushed(x, t, xp) - 0.2 * xp.abs(x[1]) * x[1] - 1.5 * s[0]]
        ),
        lambda xp, t, x, s: xp.array(
            [x[1], pushed(x, t, xp) - 0.2 * s[0] * x[1] ** 2 - 1.5 * s[0]]
        ),
        lambda xp, t, x: x[1:2],
    ),
    "a jump at the surface itself": (
        lambda xp, t, x, s: xp.array([x[1], pushed(x, t, xp) - 1.5 * xp.sign(x[1])]),
        lambda xp, t, x, s: xp.array([x[1], pushed(x, t, xp) - 1.5 * s[0]]),
        lambda xp, t, x: x[1:2],
    ),
}


@pytest.mark.parametrize("name", OSCILLATORS)
def test_kinks_give_the_motion_of_the_signs_of_a_mode(name):
    kinked, signed, switch = OSCILLATORS[name]
    one = solve(signs(kinked, lambda xp, t, x: x[1:2], [0.0, 1.0]), "event_driven")
    two = solve(signs(signed, switch, [0.0, 1.0]), "event_driven")
    assert is_compiled_and_proven(one) and np.abs(one.x - two.x).max() <= 1e-12
    wanted = [e for e in two.events if e.contact == (0, 0)]
    assert [e.kind for e in one.events] == [e.kind for e in wanted]
    np.testing.assert_allclose([e.t for e in one.events], [e.t for e in wanted], atol=1e-12)


def test_a_kink_of_a_switch_is_followed():
    swing = lambda xp, t, x, s: xp.array([x[1], -x[0] - 0.3 * s[0]])
    case = signs(swing, lambda xp, t, x: xp.abs(x[0:1]) - 0.5, [1.0, 0.0])
    traj = solve(case, "event_driven")
    times = [e.t for e in traj.events]
    assert is_compiled_and_proven(traj) and {e.kind for e in traj.events} == {"cross"}
    assert abs(times[0] - np.arccos(0.8 / 1.3)) < 1e-13 and len(times) == 6


def test_a_jump_that_both_sides_lead_to_is_refused_with_its_line():
    case = along_a_line(lambda xp, t, u: -u)
    stuck = factory(lambda xp, t, x: xp.array([-xp.sign(x[0] - 0.3), 1.0 + 0.0 * t]))
    problem = Filippov({(1,): stuck, (-1,): stuck}, factory(smooth_surface))
    traj = solve(Case("jump", problem, np.array([1.0, 0.0]), case.t), "event_driven")
    assert traj.status.code == "degenerate" and "switching surface" in str(traj.status)
    assert "`sign` in line" in str(traj.status) and __file__.rpartition("/")[2] in str(traj.status)
    assert abs(float(str(traj.status).split("t = ")[1].split()[0]) - 0.7) < 1e-5


def test_of_two_jumps_the_one_that_is_reached_is_named():
    def drift(xp, t, x):
        never = xp.where(x[0] > 9.0, 1.0, 0.0)
        return xp.array([never - xp.sign(x[0] - 0.3), 1.0 + 0.0 * t])

    problem = Filippov({(1,): factory(drift), (-1,): factory(drift)}, factory(smooth_surface))
    case = Case("jump", problem, np.array([1.0, 0.0]), np.linspace(0.0, 2.0, 5))
    traj = solve(case, "event_driven")
    assert traj.stats["loop"] == "compiled" and "`sign` in line" in str(traj.status)


@pytest.mark.parametrize("at", [1.373, 2.0 / 3.0])
def test_a_sliding_motion_is_let_go_where_the_drift_jumps(at):
    against = lambda xp, t, x, s: xp.where(t < at, 0.0, 3.0) - s + 0.0 * x
    traj = solve(signs(against, lambda xp, t, x: x, [0.5], 3.0), "event_driven")
    assert is_compiled_and_proven(traj) and abs(traj.x[-1, 0] - 2.0 * (3.0 - at)) < 1e-13
    assert [e.kind for e in traj.events] == ["enter", "exit"]
    assert abs(traj.events[1].t - at) < 1e-14


@pytest.mark.long
def test_a_start_from_which_both_sides_of_a_jump_lead_away_is_told_with_its_line():
    apart = factory(lambda xp, t, x: xp.array([xp.sign(x[0]), 1.0 + 0.0 * t]))
    problem = Filippov({(1,): apart, (-1,): apart}, factory(smooth_surface))
    traj = solve(Case("apart", problem, np.zeros(2), np.array([0.0, 0.1])), "event_driven")
    assert traj.status.code == "degenerate"
    assert "test_kinked_drifts.py" in str(traj.status) and "lead away" in str(traj.status)


TRIANGLE = np.arange(4.0), np.array([-1.0, 1.0, -1.0, 1.0])
FORCES = {
    # start, end time, end state, impulse
    "table": (lambda xp, t, y: xp.interp(t, *TRIANGLE), 0.1, 3.0, 0.25, 0.15),
    "jump": (
        lambda xp, t, y: xp.where(t < 0.7, -1.0, 2.0) - y[0],
        0.1,
        2.0,
        2.0 * (1.0 - np.exp(-1.3)),
        0.7 - np.log(1.1),
    ),
}


@pytest.mark.parametrize("name", FORCES)
def test_kinks_beside_contacts_are_proven_and_exact(name):
    force, y0, T, end, impulse = FORCES[name]
    drift = factory(lambda xp, t, y: xp.array([force(xp, t, y)]))
    traj = solve(scene(drift, floor(), x0=[y0], t=np.linspace(0.0, T, 21)), "event_driven")
    assert traj.status.ok and traj.stats["roots"] == "verified" and traj.stats["unproven"] == 0
    assert [e.kind for e in traj.events] == ["contact", "release"]
    assert abs(traj.x[-1, 0] - end) < 1e-12 and abs(traj.impulse[-1, 0] - impulse) < 1e-12


def test_a_jump_that_both_sides_lead_to_is_refused_beside_contacts():
    drift = factory(lambda xp, t, y: -xp.sign(y - 0.5))
    traj = solve(scene(drift, floor(), x0=[1.0], t=np.linspace(0.0, 2.0, 5)), "event_driven")
    assert traj.status.code == "degenerate" and "`sign` in line" in str(traj.status)


FILE = '''"""A drift that is followed in Python."""
import math
import numpy as np
from nsbench import Case, Filippov
from scipy.interpolate import CubicSpline

spline = CubicSpline([0.0, 1.0, 2.0], [0.0, 1.0, 0.0])
def drift(xp):
    def f(t, x):
        force = {}
        return xp.array([1.0 + 0.0 * t, force])
    return f

CASE = Case("slow", Filippov({{(1,): drift, (-1,): drift}}, lambda xp: lambda t, x: x[0:1] + 9.0),
            np.array([0.1, 0.0]), np.linspace(0.0, 1.0, 3))
'''
REFUSED = {
    "xp.floor(x[0])": "cannot be traced; write its jumps with xp.where",
    "spline(x[0])": "xp.searchsorted and xp.take",
    "math.sin(x[0])": "write functions of xp",
    "1.0 if x[0] > 0.0 else 2.0": "write xp.where(c, a, b) for `if c`",
    "x.prod()": "the method prod of arrays cannot be traced",
    "x[0] % 1.0": "cannot be traced; write its jumps with xp.where",
    "np.arange(3.0)[np.searchsorted(np.ones(2), x[0])]": "write xp.take(table, j) for table[j]",
    "xp.where(x[0] == 0.0, 0.0, 1.0)": "equality holds for no length of time",
    "xp.arctan2(x[0], 1.0)": "write arctan, as in",
}


def case_file(folder, force):
    path = folder / "slow.py"
    path.write_text(FILE.format(force))
    return path


@pytest.mark.long
@pytest.mark.parametrize("force", REFUSED)
def test_what_cannot_be_traced_is_named_with_its_line_and_a_remedy(force, tmp_path):
    note = solve(load_case(case_file(tmp_path, force)), "event_driven").stats["note"]
    assert "in Python" in note and "line 10 of slow.py" in note and REFUSED[force] in note


def test_check_row_and_report_say_why_a_run_is_slow(tmp_path):
    path = case_file(tmp_path, "xp.floor(x[0])")
    said = []
    check_case(load_case(path), said.append)
    row = run_one(Spec(str(path), "event_driven", "tol", 1e-10, file=str(path)))
    assert row["status"] == "ok" and "line 10 of slow.py" in row["note"]
    assert any("line 10 of slow.py" in sentence for sentence in said)
    runs = Runs("slow", "event_driven", {"status": ["ok"], "note": [row["note"]]})
    data = Data({("slow", "event_driven"): runs}, {}, {}, {}, {}, {})
    assert any("line 10 of slow.py" in n for n in write_case_notes(data, "slow", {}))


@pytest.mark.parametrize("first", [True, False])
def test_a_start_at_a_jump_that_both_sides_leave_is_seen_beside_another_kink(first):
    def drift(xp):
        def f(t, x):
            before = 0.0 if first else xp.abs(x[1] - 7.0)
            jump = xp.where(x[0] > 0.0, 1.0, -1.0)
            after = xp.abs(x[1] - 7.0) if first else 0.0
            return xp.array([jump, 0.1 * (before + after)])

        return f

    still = lambda xp: lambda t, x: xp.zeros_like(x)
    field = Filippov({1: still, -1: drift}, lambda xp: lambda t, x: xp.array([x[1] - 20.0]))
    case = Case("apart", field, np.zeros(2), np.linspace(0.0, 1.0, 5))
    run = solve(case, "event_driven")
    assert run.stats["loop"] == "compiled" and run.status.code == "degenerate"
