"""Theta stepping has the order it claims on diodes and walls, finds the least multiplier, and says
what it cannot do."""

import numpy as np
import pytest

import nsbench
from nsbench import LCS, Affine, Case, Complementarity, Distance, get_case, solve

HALF = "theta[theta=0.5]"
COARSE = np.linspace(0.0, 3.0, 13)
COUNTS = (2, 3, 5, 7, 11, 17, 26, 41, 63)  # steps per sample; no dyadic ratio


def envelope_slope(h, err):
    """Slope of the upper envelope: where an event falls in its step changes the error from step to
    step."""
    h = np.array(h)
    err = np.array(err)
    top = np.array([(err / h**2)[h <= v * 1.01][-3:].max() * v**2 for v in h])
    return np.polyfit(np.log(h), np.log(top), 1)[0]


def measured(case, spec, counts=COUNTS):
    spacing = float(np.diff(case.t).min())
    rows = []
    for n in counts:
        traj = solve(case, spec, h=spacing / n)
        assert traj.status.ok, traj.status
        e = nsbench.errors(case, traj)
        rows.append((traj.stats["h"], e["state_sup"], e["impulse"], e["reaction"]))
    return np.array(rows).T


@pytest.mark.parametrize("key", ["tide", "rlc_diode", "diode_bridge"])
def test_trapezoid_has_order_two_in_state_impulse_and_reaction(key):
    h, *errors = measured(get_case(key), HALF)
    for err in errors:
        assert envelope_slope(h, err) == pytest.approx(2.0, abs=0.1)


@pytest.mark.parametrize("key", ["tide", "rlc_diode", "diode_bridge"])
def test_implicit_euler_has_order_one(key):
    h, state, impulse, _ = measured(get_case(key), "theta", (40, 59, 83, 127, 191))
    for err in (state, impulse):
        assert np.polyfit(np.log(h), np.log(err), 1)[0] == pytest.approx(1.0, abs=0.08)


def test_a_relay_switches_and_is_first_order_at_least():
    h, state, *_ = measured(get_case("relay_lcs"), "theta", (16, 30, 55, 101, 187, 300))
    assert np.polyfit(np.log(h), np.log(state), 1)[0] == pytest.approx(0.95, abs=0.15)


def test_one_step_is_the_formula():
    p = get_case("rlc_diode").problem
    h = 1e-5
    case = get_case("rlc_diode").replace(t=np.array([0.0, h]))
    for theta in (1.0, 0.5, 0.7):
        traj = solve(case, f"theta[theta={theta}]", h=1.0)
        x = traj.x[0]
        y = traj.x[1]
        lam = traj.impulse[1] / h
        mid = (1 - theta) * x + theta * y
        assert np.abs(y - x - h * (p.A @ mid + p.B @ lam)).max() <= 1e-14 * np.abs(y).max()
        w = p.C @ mid + p.D @ lam
        assert lam[0] > 0 and abs(w[0]) <= 1e-13 * abs(mid[0])
        np.testing.assert_allclose(traj.reaction[1], p.B @ traj.impulse[1], rtol=1e-14)
        assert traj.lam_time == {1.0: "end", 0.5: "midpoint"}.get(theta, "mean")


def wall(f, C, b, x0, T=2.0, samples=21):
    return Case(
        "wall",
        Complementarity(f, (Affine(np.atleast_2d(np.asarray(C, float)), b),)),
        np.array(x0, float),
        np.linspace(0, T, samples),
    )


@pytest.mark.parametrize("theta", [1.0, 0.5])
def test_a_drift_that_is_not_affine_is_solved_to_rounding(theta):
    def f(xp):
        return lambda t, x: xp.stack(
            (xp.sin(3 * t) - x[0] ** 3 - 0.6, xp.cos(x[0]) - 0.5 * x[1] * x[1] - 2.0)
        )

    case = wall(f, [[1.0, 0.5], [0.0, 1.0]], np.array([0.1, 0.2]), [0.4, 0.3])
    traj = solve(
        case.replace(t=np.linspace(0, 2, 101)), f"theta[theta={theta}]", h=0.02
    )  # one step per sample
    fun = f(np)
    C = np.array([[1.0, 0.5], [0.0, 1.0]])
    h = 0.02
    acted = np.zeros((100, 2))
    acted[:, [c[1] for c in traj.contacts]] = np.diff(traj.impulse, axis=0)
    for k in range(100):
        old = fun(k * h, traj.x[k])
        new = fun((k + 1) * h, traj.x[k + 1])
        rest = traj.x[k + 1] - traj.x[k] - h * ((1 - theta) * old + theta * new) - C.T @ acted[k]
        gap = C @ traj.x[k + 1] + [0.1, 0.2]
        assert (
            np.abs(rest).max() < 1e-12
            and gap.min() > -1e-13
            and np.abs(np.minimum(gap, acted[k] / h)).max() < 1e-12
        )
    assert traj.contacts == ((0, 0), (0, 1)) and traj.impulse[-1].min() > 0.01


def test_walls_that_move_are_met_where_they_are():
    case = get_case("moving_floor")
    held = (case.t > 0.4) & (case.t < 2.2)
    traj = solve(case, HALF, h=0.05)
    assert np.abs(traj.x[held, 0] - 1.5 * np.sin(case.t[held])).max() < 1e-14
    lam = np.diff(traj.impulse[held, 0]) / 0.2  # x' + 1 on the floor, exactly in the mean
    np.testing.assert_allclose(lam, 1.0 + 1.5 * np.diff(np.sin(case.t[held])) / 0.2, rtol=1e-12)
    errors = [
        nsbench.errors(case, solve(case, HALF, h=h))["state_sup"] / h**2
        for h in (0.1, 0.05, 0.02, 0.01, 0.004)
    ]
    assert max(errors) < 1.0


def test_an_input_of_a_row_with_a_resistance_is_taken_at_both_ends_of_a_step():
    """w = x + lam - 2 - sin t = 0 all along: x' = lam - x = 2 + sin t - 2 x."""
    q = lambda xp: lambda t: xp.array([-2.0 - xp.sin(t)])
    case = Case("driven", LCS([[-1.0]], [[1.0]], [[1.0]], [[1.0]], q=q), np.zeros(1), COARSE)
    exact = 1.0 + (2.0 * np.sin(COARSE) - np.cos(COARSE) - 4.0 * np.exp(-2.0 * COARSE)) / 5.0
    off = lambda h: np.abs(solve(case, HALF, h=h).x[:, 0] - exact).max() / h**2
    assert off(0.05) == pytest.approx(off(0.0125), rel=0.05) and off(0.05) < 0.2


def test_compiled_and_python_loops_agree():
    tide = get_case("tide")
    opaque = lambda xp: (
        lambda t, x: xp.einsum("i->i", -xp.cos(t) * xp.ones_like(x))
    )  # numba knows no einsum
    host = tide.replace(problem=Complementarity(opaque, tide.problem.constraints))
    for spec in ("theta", HALF):
        a = solve(tide, spec, h=0.01)
        b = solve(host, spec, h=0.01)
        assert (a.stats["loop"], b.stats["loop"]) == ("compiled", "host")
        assert np.abs(a.x - b.x).max() < 1e-14 and np.abs(a.impulse - b.impulse).max() < 1e-14


def parallel():
    """Two diodes that do the same beside each other: lam1 + lam2 = cos t while the point is
    held."""
    push = lambda xp: lambda t: -xp.cos(t) * xp.ones(1)
    return Case(
        "parallel",
        LCS([[0.0]], [[1.0, 1.0]], [[1.0], [1.0]], np.zeros((2, 2)), u=push),
        np.zeros(1),
        np.linspace(0.0, 1.5, 31),
    )


def test_of_many_multipliers_the_least_is_taken():
    for spec in ("theta", HALF):
        traj = solve(parallel(), spec, h=0.01)
        assert traj.status.ok
        np.testing.assert_allclose(traj.impulse[:, 0], traj.impulse[:, 1], rtol=1e-12, atol=1e-15)
        np.testing.assert_allclose(
            traj.reaction[:, 0], np.sin(traj.t), atol=1e-2 if spec == "theta" else 1e-4
        )
        assert np.abs(traj.x).max() < 1e-14


def test_unlike_diodes_in_parallel_carry_by_their_resistance():
    unlike = LCS(
        [[-1.0]], [[1.0, 2.0]], [[1.0], [2.0]], np.zeros((2, 2)), u=lambda xp: lambda t: -xp.ones(1)
    )
    traj = solve(parallel().replace(problem=unlike), "theta", h=0.01)
    share = np.diff(traj.impulse, axis=0)[-1] / np.diff(traj.t)[-1]
    np.testing.assert_allclose(share, [0.2, 0.4], rtol=1e-12)  # least |lam| with lam1 + 2 lam2 = 1


def one(**changes):
    data = {
        "A": [[0.0]],
        "B": [[1.0]],
        "C": [[1.0]],
        "D": [[0.0]],
        "u": lambda xp: lambda t: -xp.ones(1),
    } | changes
    return Case("one", LCS(**data), np.ones(1), np.linspace(0, 2, 21))


def test_no_solution_and_several_are_told():
    wrong = one(B=[[-1.0]])  # pushes into the wall: no lam holds the point
    traj = solve(wrong, "theta", h=0.05)
    assert traj.status.code == "infeasible" and "no solution" in str(traj.status)
    assert (
        np.isfinite(traj.x[9]).all()
        and np.isnan(traj.x[-1]).all()
        and np.isnan(traj.impulse[-1]).all()
    )
    two = one(D=[[-1.0]], u=None, A=[[-1.0]])  # w = x - lam: lam = 0 or x
    traj = solve(two, "theta", h=0.05)
    assert traj.status.code == "degenerate" and "several solutions" in str(traj.status)
    beside = LCS([[-1.0, 0.0], [0.0, 0.0]], [[1.0], [0.0]], [[1.0, 0.0]], [[-1.0]])
    start = np.array([1.0, -5.0])  # another coordinate changes nothing
    traj = solve(Case("beside", beside, start, np.linspace(0.0, 1.0, 6)), "theta", h=0.05)
    assert traj.status.code == "degenerate" and "several solutions" in str(traj.status)
    ball = Case(
        "ball",
        LCS(
            [[0, 1], [0, 0]],
            [[0], [1]],
            [[1, 0]],
            [[0]],
            u=lambda xp: lambda t: xp.array([0.0, -1.0]),
        ),
        np.array([0.5, 0.0]),
        np.linspace(0, 2, 21),
    )
    traj = solve(ball, "theta", h=0.01)
    assert traj.status.code == "infeasible" and "jump" in str(traj.status)


def test_what_theta_refuses():
    why = str(solve("inconsistent", "theta").status)
    assert "inconsistent" in why and "-0.5" in why and "jump" in why
    assert solve(one(A=[[1.0]]).replace(x0=np.array([-0.3])), "theta").status.code == "refused"
    discs = Case(
        "discs",
        Complementarity(lambda xp: lambda t, x: -x, (Distance(1.0),)),
        np.arange(4.0),
        np.linspace(0, 1, 3),
    )
    assert "not linear" in str(solve(discs, "theta").status)
    assert "Filippov" in str(solve("sliding", "theta").status)
    assert "has none" in str(
        solve(discs.replace(problem=Complementarity(discs.problem.drift)), "theta").status
    )
    for bad in ("0.3", "1.5", "true", "x"):
        with pytest.raises(ValueError, match="theta is"):
            solve("tide", f"theta[theta={bad}]")


@pytest.mark.parametrize("solver", ["pbd", "catching_up", "euler", "penalty"])
def test_methods_for_other_classes_refuse_with_a_sentence(solver):
    traj = solve("rlc_diode", solver)
    assert traj.status.code == "refused" and "linear complementarity system" in str(traj.status)


@pytest.mark.parametrize(
    "name, value",
    [
        ("u", lambda xp: lambda t: xp.ones(3)),
        ("q", lambda xp: lambda t: 1.0),
        ("q", lambda xp: lambda t: np.ones(1, int)),
    ],
)
def test_inputs_of_the_wrong_shape_or_type_are_named(name, value):
    with pytest.raises(ValueError, match=f"{name} of one returns"):
        one(**{name: value})
    with pytest.raises(TypeError, match=f"{name} must be a factory"):
        one(**{name: 3.0})


def test_a_state_of_the_wrong_size_is_named():
    with pytest.raises(ValueError, match="A of one has 1 rows"):
        one().replace(x0=np.ones(2))


@pytest.mark.parametrize("spec, calls", [("theta", 1), ("theta[theta=0.5]", 2)])
def test_a_linear_system_calls_its_drift_once_for_each_end_of_a_step_that_counts(spec, calls):
    stats = solve(get_case("rlc_diode"), spec, h=1e-4).stats
    assert stats["drift_calls"] == calls * stats["steps"] > 40


def test_a_linear_system_solves_one_problem_a_step():
    stats = solve(get_case("rlc_diode"), "theta", h=1e-4).stats
    assert stats["steps"] > 40 and stats["qp_solves"] == stats["steps"] != stats["pivots"]
