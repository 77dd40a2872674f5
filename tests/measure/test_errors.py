"""Errors and residuals are what their definitions say, vanish on exact runs, and notice every kind
of wrong run."""

import itertools

import numpy as np
import pytest
from exact_runs import exact_run

import nsbench
from nsbench import LCS, Affine, Case, Complementarity, Filippov, get_case
from nsbench.case import case_names
from nsbench.dynamics.filippov.convex_hull import distance_to_hull
from nsbench.measure.context import outside_windows, tolerance
from nsbench.measure.event_times import event_errors, match
from nsbench.measure.quadrature import integrals, kinked_intervals
from nsbench.reference import closed_form
from nsbench.reference.reference import Reference
from nsbench.trajectory import Event, Status, Trajectory

TIDE = get_case("tide")
RESIDUALS = ("feasibility", "sign", "complementarity", "residual")


def hand_pbd(case, substeps):
    """Euler and projection on y >= 0, written out for tide; also the step."""
    f = case.problem.drift(np)
    h = (case.t[1] - case.t[0]) / substeps
    y = case.x0.copy()
    total = 0.0
    xs = [case.x0.copy()]
    impulses = [0.0]
    for k in range(len(case.t) - 1):
        for j in range(substeps):
            z = y + h * f(case.t[k] + j * h, y)
            y = np.maximum(z, 0.0)
            total += float((y - z)[0])
        xs.append(y)
        impulses.append(total)
    push = np.array(impulses)[:, None]
    return Trajectory(case.t, np.array(xs), ((0, 0),), push, push), h


def test_a_hand_written_method_of_order_one_shows_order_one_in_every_norm():
    runs = [
        hand_pbd(TIDE, n) for n in (2, 3, 5, 7, 10, 13, 17, 22, 29, 37, 48, 61, 79, 103, 133, 171)
    ]
    found = [nsbench.errors(TIDE, r) for r, _ in runs]
    for name in ("state_sup", "state_T", "impulse", "reaction", "l1", "settled", "residual"):
        slope = np.polyfit(np.log([h for _, h in runs]), np.log([e[name] for e in found]), 1)[0]
        assert slope == pytest.approx(1.0, abs=0.05), name
    assert all(
        e["multipliers_unique"] and e["feasibility"] == 0.0 and e["sign"] == 0.0 for e in found
    )
    # written out anew: the state, and the settled multiplier away from pi/6 and pi/2
    run, _ = runs[3]
    assert found[3]["state_sup"] == np.abs(run.x - TIDE.exact(TIDE.t)).max()
    mid = (TIDE.t[1:] + TIDE.t[:-1]) / 2
    far = np.min(np.abs(mid[:, None] - np.array(TIDE.exact_events)), axis=1) > 2.6 * 0.05
    off = np.abs(np.diff(run.impulse - TIDE.exact_impulse(TIDE.t), axis=0))[:, 0]
    assert found[3]["settled"] == pytest.approx(off[far].max() / 0.05)
    assert found[3]["l1"] == pytest.approx(off.sum())


CLOSED = [n for n in case_names() if get_case(n).exact_impulse is not None]


@pytest.mark.long
@pytest.mark.parametrize("name", CLOSED)
def test_a_closed_form_has_neither_errors_nor_residuals(name):
    case = get_case(name)
    e = nsbench.errors(case, exact_run(case, stats={"events": 0}))
    scale = max(1.0, np.abs(closed_form(case).x).max())
    for key in ("state_sup", "state_T", "impulse", "reaction", "l1", "settled", "event_time"):
        assert np.isnan(e[key]) or e[key] == 0.0, key
    assert e["events_missed"] == e["events_extra"] == 0
    assert not e["feasibility"] > 1e-12 * scale and e["sign"] > -1e-12
    # switches that accumulate lie between two samples, where complementarity has an error of the
    # spacing squared
    assert e["complementarity"] < 1e-12 * scale or name == "spiral"
    assert e["residual"] < 1e-6 * scale, "the quadrature promises more than it keeps"


@pytest.mark.parametrize(
    "name, change, key, size",
    [
        ("tide", lambda r: {"x": r.x + 1e-3 * (r.t > 1)[:, None]}, "residual", 0.0199),
        ("tide", lambda r: {"x": r.x - 1e-3}, "feasibility", 1e-3),
        (
            "tide",
            lambda r: {"impulse": 1.01 * r.impulse, "reaction": 1.01 * r.reaction},
            "residual",
            0.005,
        ),
        ("tide", lambda r: {"impulse": 1.01 * r.impulse}, "residual", 0.005),
        ("tide", lambda r: {"impulse": -r.impulse, "reaction": -r.reaction}, "sign", -0.8),
        ("tide", lambda r: {"x": r.x + 0.1}, "complementarity", 0.08),
        ("sliding", lambda r: {"x": r.x + 1e-2 * np.outer(r.t, [1, 0])}, "residual", 5e-3),
        ("sliding", lambda r: {"x": r.x + np.array([0, 1e-2])}, "complementarity", 4e-3),
        ("sliding", lambda r: {"impulse": 2.1 * r.impulse}, "sign", -1.0),
        ("two_discs", lambda r: {"x": 0.99 * r.x}, "feasibility", 0.019),
    ],
)
@pytest.mark.survives("own residuals")
def test_residuals_notice_a_wrong_run(name, change, key, size):
    case = get_case(name)
    run = exact_run(case)
    right, wrong = (nsbench.errors(case, r)[key] for r in (run, exact_run(case, **change(run))))
    assert abs(right) < 1e-6
    assert wrong <= size if size < 0 else wrong >= size, wrong


def test_the_state_error_is_the_largest_coordinate_at_the_worst_sample():
    case = get_case("two_discs")
    off = np.zeros((len(case.t), 4))
    off[7] = [0.0, -0.3, 0.2, 0.0]
    off[-1] = [0.1, 0.0, 0.0, 0.05]
    e = nsbench.errors(
        case,
        exact_run(case, x=closed_form(case).x + off, reaction=closed_form(case).reaction + off),
    )
    assert e["state_sup"] == pytest.approx(0.3) and e["state_T"] == pytest.approx(0.1)
    assert e["reaction"] == pytest.approx(0.3) and e["impulse"] == 0.0


def test_a_contact_is_closed_within_the_reference_error_and_rounding():
    known = Reference(np.zeros(1), np.array([[5.0, -7.0]]), (), None, None, None, 3e-9)
    assert tolerance(known) == pytest.approx(3e-8 + 7e-10, rel=1e-12)


def test_windows_are_two_samples_wide():
    t = np.linspace(0, 1, 11)
    assert np.flatnonzero(~outside_windows(t, np.array([0.55]))).tolist() == [3, 4, 5, 6, 7]
    assert np.flatnonzero(~outside_windows(t, np.array([0.5]))).tolist() == [3, 4, 5, 6]
    assert np.flatnonzero(~outside_windows(t, np.array([0.0]))).tolist() == [0, 1]
    assert np.flatnonzero(~outside_windows(t, np.array([1.0]))).tolist() == [8, 9]
    assert outside_windows(t, np.array([])).all()


def test_events_are_matched_in_order_with_the_least_total_difference():
    rng = np.random.default_rng(2)
    for _ in range(30):
        a = np.sort(rng.uniform(size=3))
        b = np.sort(rng.uniform(size=rng.integers(3, 7)))
        best = min(
            sum(abs(x - y) for x, y in zip(a, c, strict=True)) for c in itertools.combinations(b, 3)
        )
        assert match(a, b).sum() == pytest.approx(best) and match(b, a).sum() == pytest.approx(best)
    p = get_case("two_discs").problem
    want = (Event(0.5, "contact", (0, 0, 1)), Event(0.9, "release", (0, 0, 1)))
    assert event_errors(p, want, want) == (0.0, 0, 0)
    found = (Event(0.51, "contact", (0, 1, 0)), Event(0.6, "contact", (0, 0, 1)))
    worst, missed, extra = event_errors(p, found, want)
    assert worst == pytest.approx(0.01) and (missed, extra) == (1, 1)
    worst, missed, extra = event_errors(p, found[:1], (Event(0.5, "", ()), Event(0.9, "", ())))
    assert worst == pytest.approx(0.01) and (missed, extra) == (1, 0)
    silent = nsbench.errors(TIDE, exact_run(TIDE, events=(), stats={}))
    assert np.isnan(silent["event_time"]) and np.isnan(silent["events_missed"])
    deaf = nsbench.errors(TIDE, exact_run(TIDE, events=(), stats={"events": 0}))
    assert np.isnan(deaf["event_time"]) and deaf["events_missed"] == 2


def test_a_change_of_basis_is_no_event_of_the_solution():
    both = (Event(1.0, "contact", (0, 0, 1)), Event(2.0, "release", (0, 0, 1)))
    mine = (*both, Event(1.5, "pivot", (0, 0, 2)))
    other = (*both, Event(1.2, "pivot", (0, 1, 2)), Event(1.6, "pivot", (0, 0, 3)))
    assert event_errors(nsbench.get_case("three_discs").problem, mine, other) == (0.0, 0, 0)


def test_the_quadrature_keeps_its_bound():
    rng = np.random.default_rng(3)
    for n in (11, 21, 41):
        t = np.linspace(0, 2, n) + np.append(0, np.cumsum(rng.uniform(0, 1e-3, n - 1)))
        value, bound = integrals(t, np.sin(3 * t)[:, None], np.zeros(n - 1, bool))
        off = np.abs(value[:, 0] - np.diff(-np.cos(3 * t) / 3))
        assert np.all(off <= bound[:, 0] + 1e-15) and off.max() < 12 * (t[1] - t[0]) ** 7
        for kink in rng.uniform(0.3, 1.7, 20):
            value, bound = integrals(
                t, np.abs(t - kink)[:, None], kinked_intervals(t, np.zeros(n - 2, bool), [kink])
            )
            exact = np.diff(np.sign(t - kink) * (t - kink) ** 2 / 2)
            assert np.all(np.abs(value[:, 0] - exact) <= bound[:, 0] + 1e-15)


@pytest.mark.parametrize("jump", (0.0, 0.03, 1.0))
def test_the_quadrature_keeps_its_bound_at_kinks_and_jumps_that_no_event_tells(jump):
    rng = np.random.default_rng(4)
    for n in (17, 33):
        t = np.linspace(0, 2, n)
        for place in (*rng.uniform(0.3, 1.7, 40), 1.0):
            F = np.sin(t) + np.abs(t - place) + jump * (t >= place)
            sure = (t - place) * np.abs(t - place) / 2 + jump * np.maximum(t - place, 0.0)
            value, bound = integrals(t, F[:, None], np.zeros(n - 1, bool))
            exact = np.diff(sure - np.cos(t))
            far = np.abs((t[1:] + t[:-1]) / 2 - place) > 6 * t[1]
            assert np.all(np.abs(value[:, 0] - exact) <= 1.2 * bound[:, 0] + 1e-15)
            assert bound[far].max() < 1e-5


def test_a_field_that_jumps_between_samples_shows_no_defect_of_an_exact_run():
    def saw(t, x, s):
        return np.stack((3 * t % 1, s[0] + np.sin(t)))

    problem = Filippov(None, lambda xp: lambda t, x: x[1:2], lambda xp: saw, 1)
    t = np.linspace(0.0, 2.0, 33)
    case = Case("saw", problem, (0.0, 1.0), t)
    teeth = np.floor(3 * t)
    x = np.stack(((teeth + (3 * t - teeth) ** 2) / 6, 2 + t - np.cos(t)), axis=1)
    for factor, residual in ((1.0, 0.0), (1.01, 0.01)):
        run = Trajectory(t, x * (factor, 1.0), ((0, 0),), t[:, None], np.zeros((33, 0)))
        found = nsbench.errors(case, run)["residual"]
        assert found == pytest.approx(residual, abs=1e-13 + 0.5 * residual)


def test_distance_to_a_hull_is_that_of_the_nearest_mixture():
    rng = np.random.default_rng(6)
    weights = rng.dirichlet(np.ones(4) * 0.7, 20000)
    for _ in range(10):
        v = 2 * rng.normal(size=2)
        points = rng.normal(size=(4, 2))
        near = np.linalg.norm(weights @ points - v, axis=1).min()
        assert near - 0.05 < distance_to_hull(v, points) <= near + 1e-6
    assert distance_to_hull(points.mean(axis=0), points) < 1e-6
    assert distance_to_hull(np.zeros(1), np.array([[1.0], [3.0]])) == 1.0


def test_a_mixture_is_as_near_to_its_hull_as_rounding_allows():
    rng = np.random.default_rng(3)
    for _ in range(500):
        points = rng.normal(size=(rng.integers(3, 9), rng.integers(1, 5)))
        points[0] = points[rng.integers(len(points))]  # fields of surfaces that are one are alike
        assert distance_to_hull(rng.dirichlet(np.ones(len(points))) @ points, points) < 1e-14


@pytest.mark.parametrize("unit", (1e-100, 1e-12, 1e-8, 1e8))
def test_the_distance_to_a_hull_has_the_unit_of_its_points(unit):
    rng = np.random.default_rng(1)
    for n, m in ((1, 3), (2, 4), (3, 8)):
        points = rng.standard_normal((m, n))
        for v in (rng.standard_normal(n), rng.dirichlet(np.ones(m)) @ points, np.full(n, 5.0)):
            scaled = distance_to_hull(unit * v, unit * points) / unit
            assert scaled == pytest.approx(distance_to_hull(v, points), rel=1e-9, abs=1e-11)
    assert distance_to_hull(np.ones(2), np.ones((4, 2))) == 0.0


def test_a_run_that_touches_nothing_has_nothing_to_complement():
    t = np.linspace(0.0, 1.0, 5)
    rows = Affine([[1.0]], [1.0])
    free = Case("free", Complementarity(lambda xp: lambda t, x: 0.0 * x, [rows]), [0.0], t)
    e = nsbench.errors(free, nsbench.solve(free, "pbd", h=0.25))
    assert e["feasibility"] == e["complementarity"] == 0.0


def test_a_failed_run_has_residuals_and_no_errors():
    run = hand_pbd(TIDE, 10)[0]
    x = run.x.copy()
    push = run.impulse.copy()
    x[30:], push[30:] = np.nan, np.nan
    e = nsbench.errors(
        TIDE, Trajectory(TIDE.t, x, run.contacts, push, push, Status("nan", "It stopped."))
    )
    assert all(
        np.isnan(e[k])
        for k in ("state_sup", "state_T", "impulse", "reaction", "l1", "settled", "sup")
    )
    assert 0 < e["residual"] < 0.01 and e["feasibility"] == 0.0
    for state, impulse in (
        (x, run.impulse),
        (run.x, push),
    ):  # a solver that says ok is not believed
        e = nsbench.errors(TIDE, Trajectory(TIDE.t, state, run.contacts, impulse, run.reaction))
        assert np.isnan(e["state_sup"]) and np.isnan(e["reaction"])
    none = np.empty((0, 0))
    e = nsbench.errors(
        TIDE, Trajectory(np.empty(0), np.empty((0, 1)), (), none, none, Status("refused", "No."))
    )
    assert (
        all(np.isnan(e[k]) for k in (*RESIDUALS, "state_sup")) and e["reference"] == "closed form"
    )
    with pytest.raises(ValueError, match="60 samples"):
        nsbench.errors(
            TIDE, Trajectory(TIDE.t[1:], run.x[1:], run.contacts, run.impulse[1:], run.reaction[1:])
        )


def test_a_linear_complementarity_system_has_errors_and_residuals():
    one = np.eye(1)
    case = Case(
        "tide_lcs",
        LCS(0 * one, one, one, 0 * one, u=lambda xp: lambda t: -xp.cos(t) * xp.ones(1)),
        TIDE.x0,
        TIDE.t,
        exact=TIDE.exact,
        exact_impulse=TIDE.exact_impulse,
        exact_events=TIDE.exact_events,
    )
    run = exact_run(case)
    assert run.contacts == ((0, 0),) and np.abs(run.reaction - run.impulse).max() < 1e-14
    e = nsbench.errors(case, run)
    assert (
        e["state_sup"] == e["impulse"] == 0.0
        and max(e[k] for k in RESIDUALS) < 1e-9
        and e["sign"] == 0.0
    )
    assert nsbench.errors(case, exact_run(case, x=run.x - 0.1))["feasibility"] == pytest.approx(0.1)
    assert nsbench.errors(case, exact_run(case, impulse=1.1 * run.impulse))["residual"] > 0.05
    assert nsbench.errors(case, exact_run(case, reaction=np.empty((61, 0))))["residual"] < 1e-9


def test_two_samples_do_not_tell_how_an_integrand_moves_between_them():
    for name, unknown in (
        ("rlc_diode", {"feasibility", "complementarity", "residual"}),
        ("tide", {"residual"}),
        ("slide_exit", {"feasibility", "residual"}),
    ):
        case = get_case(name)
        case = case.replace(name="brief", t=case.t[[0, -1]])
        e = nsbench.errors(case, nsbench.solve(case, "event_driven", tol=1e-10))
        assert {k for k in RESIDUALS if np.isnan(e[k])} == unknown


def test_a_weight_that_varies_between_samples_is_no_defect():
    case = get_case("slide_exit")
    assert nsbench.errors(case, nsbench.solve(case, "event_driven", tol=1e-12))["residual"] < 1e-9


def test_two_weights_that_move_alike_are_not_unique():
    def field(xp):
        return lambda t, x, s: xp.array([1.0, 0.0]) - xp.array([0.0, 1.0]) * (s[0] + s[1])

    t = np.linspace(0, 1, 11)
    case = Case(
        "twice",
        Filippov.signs(field, lambda xp: lambda t, x: xp.stack((x[1], x[1]))),
        np.zeros(2),
        t,
        exact=lambda t: np.stack([t, 0 * t], 1),
        exact_impulse=lambda t: np.stack([t / 2, t / 2], 1),
    )
    assert nsbench.errors(case, exact_run(case, events=()))["multipliers_unique"] is False
    assert (
        nsbench.errors(get_case("sliding"), exact_run(get_case("sliding")))["multipliers_unique"]
        is True
    )


@pytest.mark.parametrize("samples", [3, 101])
@pytest.mark.parametrize("D", [0.0, 1.0])
def test_a_push_of_an_open_diode_is_no_complementarity(samples, D):
    """x' = lam, w = x + D lam, pushed by lam = 1 from x = 1 on: the product is at least 1 wherever
    it is looked at."""
    t = np.linspace(0.0, 1.0, samples)
    case = Case("pushed", LCS(*(np.array([[v]]) for v in (0.0, 1.0, 1.0, D))), np.array([1.0]), t)
    traj = Trajectory(
        t, 1.0 + t[:, None], ((0, 0),), t[:, None], np.empty((samples, 0)), Status(), (), {}, "mean"
    )
    e = nsbench.errors(case, traj)
    assert e["complementarity"] > 1.0 and e["residual"] < 1e-12


def test_theta_keeps_w_at_the_ends_of_steps_and_shows_a_violation_of_means_that_falls():
    """A charged capacitor: w = C x + D lam + q is 0 at the end of each step in which lam acts."""
    source = lambda xp: lambda t: -xp.sin(2 * xp.pi * t) * xp.ones(1)
    system = LCS(A=[[-2.5]], B=[[5.0]], C=[[1.0]], D=[[0.5]], q=source)
    seen = []
    for steps in (40, 80, 160):
        case = Case(name="c", problem=system, x0=np.zeros(1), t=np.linspace(0.0, 2.0, 41))
        fine = case.replace(t=np.linspace(0.0, 2.0, steps + 1))
        traj = nsbench.solve(fine, "theta", h=2.0 / steps)
        lam = np.diff(traj.impulse[:, 0]) * steps / 2.0
        w = traj.x[1:, 0] + 0.5 * lam - np.sin(2 * np.pi * fine.t[1:])
        assert w.min() > -1e-14 and np.abs(w * lam).max() < 1e-13
        found = nsbench.errors(case, nsbench.solve(case, "theta", h=2.0 / steps))
        seen.append(found["feasibility"])
    assert 0.0 < seen[2] < 0.7 * seen[1] < 0.7 * 0.7 * seen[0]
