"""Error bars of a run: bounds above the error at every sample, estimates near it, in any unit."""

import json

import numpy as np
import pytest
from changed_cases import units

import nsbench
from nsbench import Affine, Case, Complementarity, Distance, get_case
from nsbench.cli import main
from nsbench.dynamics.contacts.constraint_set import ConstraintSet
from nsbench.error_bars import error_bars
from nsbench.error_bars.bars import Leg
from nsbench.error_bars.contact_rows import ContactRows
from nsbench.error_bars.drift import Drift
from nsbench.error_bars.local_solution import local_solution
from nsbench.error_bars.shadow import Shadow
from nsbench.error_bars.split_bound import SplitBound
from nsbench.reference import reference
from nsbench.solvers.common.time_grid import grid

FLAT = ("tide", "rods[n=5]", "wedge", "play", "moving_floor", "box_turning")
CURVED = ("discs[n=3]", "three_discs", "obstacle")


def error_of(case, traj):
    """(k,) |x - x*| at the samples, in the 2-norm."""
    return np.linalg.norm(traj.x - reference(case).x, axis=1)


@pytest.mark.long
@pytest.mark.parametrize("method", ["pbd", "pbd[order=reverse]", "catching_up"])
@pytest.mark.parametrize("name", FLAT)
def test_a_bound_is_above_the_error_at_every_sample(name, method):
    case = get_case(name)
    for h in (np.diff(case.t).min(), 7e-3):
        traj = nsbench.solve(case, method, h=h)
        error = error_of(case, traj)
        assert traj.bound.is_proven
        assert np.all(traj.bound.state >= error)
        if error.max() > 1e-9:
            assert traj.bound.state.max() <= 3.0 * error.max()
        off = np.linalg.norm(traj.reaction - reference(case).reaction, axis=1)
        assert np.all(traj.bound.reaction >= off * (1.0 - 1e-9))


@pytest.mark.long
@pytest.mark.parametrize("method", ["pbd", "catching_up"])
@pytest.mark.parametrize("name", CURVED)
def test_an_estimate_is_near_the_error(name, method):
    case = get_case(name)
    traj = nsbench.solve(case, method, h=7e-3)
    assert not traj.bound.is_proven
    assert 1.0 <= traj.bound.state.max() / error_of(case, traj).max() <= 10.0


def turning_drift(xp):
    def f(t, x):
        pull = xp.array([xp.cos(3.0 * t), xp.sin(3.0 * t), 0.4 * xp.cos(7.0 * t)])
        return 2.0 * pull + xp.array([0.3 * x[1], -0.3 * x[0], -0.5 * x[2] + 0.2 * x[0]])

    return f


def three_walls(**changes):
    """A point between three oblique walls, under a drift that turns: in no catalogue."""
    N = np.array([[0.6, 0.8, 0.0], [-0.6, 0.64, 0.48], [0.0, -0.28, -0.96]])
    walls = Affine(A=N, b=np.array([0.3, 0.35, 0.4]))
    problem = Complementarity(turning_drift, (walls,))
    case = Case(name="three_walls", problem=problem, x0=np.zeros(3), t=np.linspace(0.0, 4.0, 41))
    return case.replace(**changes)


@pytest.mark.long
@pytest.mark.parametrize("method", ["pbd", "catching_up"])
def test_a_scene_of_ones_own_has_a_bound(method):
    case = three_walls()
    truth = nsbench.solve(case, "event_driven")
    assert truth.status.ok
    for h in (0.1, 2e-2, 2e-3):
        traj = nsbench.solve(case, method, h=h)
        error = np.linalg.norm(traj.x - truth.x, axis=1)
        assert np.all(traj.bound.state >= error)
        # contacts erase errors, and one that takes over from another turns them: their direction
        # is known through both, which needs no Lipschitz constant
        assert traj.bound.state.max() <= 3.0 * error.max()
        off = np.linalg.norm(traj.reaction - truth.reaction, axis=1)
        assert np.all(traj.bound.reaction >= off)
        assert traj.bound.reaction.max() <= 4.0 * off.max()


def test_a_bound_has_the_units_of_the_state():
    """Powers of two: the same bits."""
    case = three_walls()
    other = units(case, 2.0**-20, 2.0**10).case
    one = nsbench.solve(case, "catching_up", h=0.01)
    two = nsbench.solve(other, "catching_up", h=0.01 * 2.0**-20)
    assert np.array_equal(one.bound.state * 2.0**10, two.bound.state)
    assert np.array_equal(one.bound.reaction * 2.0**10, two.bound.reaction)


def point_scene(f, rows, gaps, t, x0=(0.0,)):
    """A point under the drift f(xp, t, x) beside the walls rows . x + gaps >= 0."""

    def drift(xp):
        return lambda t, x: xp.array(f(xp, t, x))

    walls = Affine(A=np.array(rows, float), b=np.array(gaps, float))
    problem = Complementarity(drift, (walls,))
    return Case(name="point", problem=problem, x0=np.array(x0), t=np.array(t, float))


HARD_TO_SEE = {
    # pressed all the time: nothing but the integral of the drift along the curve is wrong
    "pressed": point_scene(
        lambda xp, t, x: [-2.0 + xp.cos(6.0 * t + 0.3)], [[1.0]], [0.0], np.arange(0.0, 7.0)
    ),
    # at rest where an interval begins: what is near cannot be told by the speed there
    "rest": point_scene(
        lambda xp, t, x: [xp.sin(2.0 * t), x[0] + xp.sin(2.0 * t)],
        [[-10.0, 0.0]],
        [1.0],
        np.arange(0.0, 4.1, 0.5),
        (0.0, 0.0),
    ),
    # both walls of a slab act in every interval, never at once
    "slab": point_scene(
        lambda xp, t, x: [2.0 * xp.cos(31.4 * t + 0.3)],
        [[1.0], [-1.0]],
        [0.025, 0.025],
        np.arange(0.0, 3.01, 0.1),
    ),
    # the quarters of the intervals see a constant drift
    "aliased": point_scene(
        lambda xp, t, x: [3.0 * xp.cos(8.0 * np.pi * t)], [[1.0]], [90.0], np.arange(0.0, 6.0)
    ),
}


@pytest.mark.parametrize("h", [1.0, 0.06])
@pytest.mark.parametrize("name", HARD_TO_SEE)
def test_a_bound_holds_where_the_recorded_states_show_little(name, h):
    case = HARD_TO_SEE[name]
    truth = nsbench.solve(case, "event_driven")
    assert truth.status.ok
    traj = nsbench.solve(case, "pbd", h=min(h, case.t[1]))
    assert traj.bound.is_proven
    assert np.all(traj.bound.state >= np.linalg.norm(traj.x - truth.x, axis=1) - 1e-10)
    off = np.linalg.norm(traj.reaction - truth.reaction, axis=1)
    assert np.all(traj.bound.reaction >= off - 1e-10)


def test_no_bound_is_proven_behind_particles_that_passed_through_one_another():
    traj = nsbench.solve("rods[n=10]", "pbd", h=0.1)
    assert not traj.bound.is_proven
    assert "passed" in traj.bound.why


@pytest.mark.parametrize("name, most", [("tide", 1.5), ("discs[n=10]", 6.0)])
def test_error_bars_shrink_with_the_step_as_far_as_the_error_does(name, most):
    # local solutions of low order have a residual that does not depend on the step of the run
    case = get_case(name)
    traj = nsbench.solve(case, "pbd", h=1e-5)
    error = np.linalg.norm(traj.x - reference(case).x, axis=1).max()
    assert error <= traj.bound.state.max() <= most * error


def test_switches_have_no_error_bars_and_failed_runs_say_why():
    assert nsbench.solve("slide_exit", "euler", h=0.01).bound is None
    row = nsbench.errors(get_case("slide_exit"), nsbench.solve("slide_exit", "euler", h=0.01))
    assert np.isnan(row["bound_state"])
    assert np.isnan(row["estimate_state"])


def test_bars_reach_the_row_as_bound_or_estimate():
    case = get_case("tide")
    row = nsbench.errors(case, nsbench.solve(case, "pbd", h=0.01))
    assert row["bound_state"] >= row["state_sup"]
    assert np.isnan(row["estimate_state"])
    # the multiplier is cos t between its impact and its release, and 0 elsewhere
    assert row["lam_variation"] == pytest.approx(2.0 * np.cos(np.pi / 6), rel=0.05)
    disc = get_case("three_discs")
    row = nsbench.errors(disc, nsbench.solve(disc, "pbd", h=0.01))
    assert row["estimate_state"] >= row["state_sup"]
    assert np.isnan(row["bound_state"])


def test_a_tolerance_is_refused_where_there_are_no_error_bars():
    case = three_walls(t=np.array([0.0, 1.0]))
    assert "three samples" in nsbench.solve(case, "pbd[tol=1e-3]").status.why


def test_recorded_states_change_no_step():
    t = np.array([0.0, 1.0, 1.5, 4.0])
    plain = grid(t, 0.03)
    many = grid(t, 0.03, states=2)
    assert many.substeps.sum() == plain.substeps.sum()
    assert np.isin(t, many.t).all()
    assert many.h == plain.h
    steps = np.diff(many.t) / many.substeps
    assert steps == pytest.approx(np.repeat(np.diff(t) / plain.substeps, [9, 5, 21]), rel=1e-12)
    assert grid(t, 0.03, states=701).aligned


def test_step_answers_for_a_case_and_an_error(capsys):
    asked = ["step", "tide", "--error", "1e-2", "-s", "pbd", "-s", "event_driven", "--json"]
    assert main(asked) == 0
    answer = json.loads(capsys.readouterr().out)
    pbd, exact = answer["methods"]
    assert pbd["sure"] == "proven bound"
    assert exact["sure"] == "claimed by the method"
    case = get_case("tide")
    error = error_of(case, nsbench.solve(case, "pbd", h=pbd["accuracy"])).max()
    assert error <= pbd["error"] <= 1e-2
    assert answer["cheapest"] == "pbd"
    assert main(["step", "tide", "--error", "much"]) == 2


def test_error_bars_use_one_thread_of_blas(monkeypatch):
    """A row of a worker, which has one, and a run in Python get the same bits; no thread waits."""
    from threadpoolctl import threadpool_info, threadpool_limits

    from nsbench.error_bars import bars

    threads = []

    def look(*args):
        threads.append(max(i["num_threads"] for i in threadpool_info() if i["user_api"] == "blas"))
        return local_solution(*args)

    local_solution = bars.local_solution
    monkeypatch.setattr(bars, "local_solution", look)
    with threadpool_limits(2, "blas"):
        run = nsbench.solve(nsbench.get_case("tide"), "pbd", h=0.05)
        assert np.isfinite(run.bound.state).all()
    assert set(threads) == {1}


def tether(f):
    """A point on a line, tethered to where it starts, beside a coordinate that it drives."""

    def drift(xp):
        return lambda t, x: xp.array(f(xp, t, x))

    links = (Distance(d=1.0, sign=-1, dim=1, pairs=[[0, 0]], anchors=[[0.0]]),)
    problem = Complementarity(drift, links)
    return Case(name="tether", problem=problem, x0=np.zeros(2), t=np.linspace(0.0, 2.0, 21))


TETHERS = {
    "stable": lambda xp, t, x: [1.0 + 0.5 * xp.cos(3.0 * t), 2.0 * xp.cos(t) - x[0]],
    "growing": lambda xp, t, x: [1.0 + 0.5 * xp.cos(3.0 * t), 3.0 * (x[0] - 1.0) - xp.cos(2.0 * t)],
}


@pytest.mark.parametrize("h", [0.1, 0.01])
@pytest.mark.parametrize("name", TETHERS)
def test_a_bound_holds_for_a_tether_whose_ends_coincide_at_the_start(name, h):
    case = tether(TETHERS[name])
    truth = nsbench.solve(case, "event_driven")
    traj = nsbench.solve(case, "pbd", h=h)
    assert traj.bound.is_proven
    assert np.all(traj.bound.state >= np.linalg.norm(traj.x - truth.x, axis=1) - 1e-10)
    off = np.linalg.norm(traj.reaction - truth.reaction, axis=1)
    assert np.all(traj.bound.reaction >= off - 1e-10)


def test_the_comparison_curve_stays_feasible_between_its_nodes():
    """Two points on a line that touch at some nodes, and are drawn together between them."""

    def drift(xp):
        return lambda t, x: xp.array([xp.sin(2.0 * np.pi * t), -xp.sin(2.0 * np.pi * t)])

    problem = Complementarity(drift, (Distance(d=1.0, dim=1),))
    scene = ConstraintSet(problem, 2)
    t = np.arange(5.0)
    shadow = Shadow(scene, Drift(drift, 2))
    x = np.tile([0.0, 1.0], (5, 1))
    steep = np.array([[0.3, -0.3], [-0.3, 0.3]])
    arcs = shadow.arcs(t[:1], np.ones(1), x[:1], x[1:2], steep[:1], steep[1:], ())
    assert not arcs.inside[0]


def test_an_event_at_the_very_end_of_an_interval_leaves_a_bar():
    """A piece of the local solution that ended there was followed by one of no length: NaN."""
    case = get_case("graze")
    for moved in ((0.4, 0.9), (0.9, 0.4), (0.1, 1.0)):
        near = case.replace(x0=case.x0 + 1e-12 * np.array(moved))
        bars = nsbench.solve(near, "pbd", h=0.05).bound
        assert bars.is_proven and 0.02 < bars.state[-1] < 0.04


@pytest.mark.long
@pytest.mark.parametrize(
    "method, name, accuracy, most",
    [
        ("theta", "tide", 0.01, 1.05),
        ("theta[theta=0.5]", "box_turning", 0.01, 3.0),
        ("penalty", "rods_wall", 300.0, 1.05),
        ("penalty", "discs[n=3]", 300.0, 2.0),
    ],
)
def test_implicit_steps_and_springs_have_error_bars_too(method, name, accuracy, most):
    """Of their recorded states, which need not be feasible, as of those of PBD."""
    case = get_case(name)
    traj = nsbench.solve(case, method, **{nsbench.solvers.get(method).accuracy: accuracy})
    ref = reference(case)
    assert traj.bound.is_proven == (name != "discs[n=3]")
    for bar, off in (
        (traj.bound.state, traj.x - ref.x),
        (traj.bound.reaction, traj.reaction - ref.reaction),
    ):
        error = np.linalg.norm(off, axis=1)
        assert np.all(bar[1:] >= error[1:])
        assert 1.0 <= bar.max() / error.max() < most


def test_a_contact_that_closes_is_found_however_large_the_scene_is():
    """Candidates are taken by the way of particles: a lone pair that meets at t = 0.5, beside a
    hundred others that all move."""
    rest = np.arange(200.0).reshape(100, 2) * 10.0
    x0 = np.append(rest.ravel(), [-30.0, 0.0, -31.5, 0.0])
    pull = np.tile([0.0, 1.0], 102)
    pull[-4:] = 0.0, 0.0, 1.0, 0.0
    scene = ConstraintSet(Complementarity(lambda xp: None, (Distance(1.0),)), 204)
    end = x0 + 2.0 * pull
    end[-4:] = -30.0 + 0.75, 0.0, -31.0 + 0.75, 0.0
    shadow = Shadow(scene, Drift(lambda xp: lambda t, x: pull + 0.0, 204))
    found = local_solution(shadow, 0.0, 2.0, x0, end)
    assert found.is_complete
    assert np.abs(found.state - end).max() < 1e-10


def test_an_error_whose_square_underflows_is_carried_on_as_it_is():
    walls = Complementarity(lambda xp: lambda t, x: -x, (Affine(np.eye(1), np.zeros(1)),))
    scene = ConstraintSet(walls, 1)
    none = ContactRows(scene, ())
    leg = Leg(0.0, 1.0, none, np.ones(1), np.empty(0), none, np.ones(1))
    tiny = np.array([1e-170])
    new, pulled = leg.carried(Shadow(scene, Drift(walls.drift, 1)).kernels, tiny)
    assert np.array_equal(new, tiny)
    assert not pulled.any()


@pytest.mark.parametrize(("method", "h"), [("theta", 1e-2), ("theta", 1e-3), ("pbd", 1e-3)])
def test_the_bound_of_a_stiff_scene_falls_with_the_step(method, h):
    """Samples lie 15 times the time 1 / K apart in which the spring forgets: pieces of local
    solutions are stable steps, and of a residual only what is not forgotten counts."""
    case = get_case("stiff_contact")
    traj = nsbench.solve(case, method, h=h)
    error = np.abs(traj.x - case.exact(traj.t))[:, 0]
    assert traj.bound.is_proven
    assert np.all(traj.bound.state >= error - 1e-13)
    assert traj.bound.state.max() <= 5.0 * error.max()


def test_theta_records_what_a_stiff_drift_forgets_between_samples():
    """Samples lie 30 times as far apart as one direction forgets: what the run does at an event is
    seen in the states between them alone."""
    axes = np.linalg.qr([[1.0, 0.3, 0.2], [-0.4, 1.0, 0.5], [0.1, -0.6, 1.0]])[0]
    pull = axes @ np.diag([300.0, 1.0, 1.0]) @ axes.T
    centre = np.array([1.0, -0.7, 0.4])
    phase = np.array([0.0, 1.0, 2.0])

    def pulled(xp):
        def f(t, x):
            return (pull * (centre * xp.sin(5.0 * t + phase) - x)).sum(axis=1)

        return f

    scene = three_walls(t=np.linspace(0.0, 3.0, 31))
    case = scene.replace(problem=Complementarity(pulled, scene.problem.constraints))
    truth = nsbench.solve(case, "event_driven")
    traj = nsbench.solve(case, "theta", h=2e-3)
    error = np.linalg.norm(traj.x - truth.x, axis=1)
    assert truth.status.ok and traj.bound.is_proven
    assert np.all(traj.bound.state >= error - 1e-10)
    assert traj.bound.state.max() <= 5.0 * error.max()


@pytest.mark.parametrize("name", ["tide", "wedge", "moving_floor", "rods[n=10]"])
def test_a_bound_is_the_same_over_arcs_together_and_one_by_one(name, monkeypatch):
    case = nsbench.get_case(name)
    traj = nsbench.solve(case, "catching_up", h=0.01)
    carried = []
    over_arcs = SplitBound._over_arcs

    def counted(self, j, known, out):
        count, new = over_arcs(self, j, known, out)
        carried.append(count)
        return count, new

    monkeypatch.setattr(SplitBound, "_over_arcs", counted)
    together = error_bars(case, traj).made
    assert together.is_proven and max(carried) > 5
    monkeypatch.setattr(SplitBound, "_over_arcs", lambda self, j, known, out: (0, known))
    alone = error_bars(case, traj).made
    for bar in ("state", "reaction", "impulse"):
        assert np.allclose(getattr(together, bar), getattr(alone, bar), rtol=1e-12, atol=0.0)
