"""Catching up solves the QP of every step to rounding, whoever solves it, and says so when it does
not."""

import numpy as np
import pytest

import nsbench
from nsbench import Affine, Case, Complementarity, Distance, Smooth
from nsbench.solvers import get

ACCURATE = ("catching_up", "catching_up[backend=osqp]", "catching_up[backend=piqp]")


def still(xp):
    def f(t, x):
        return 0.0 * x

    return f


def pull(xp):
    def f(t, x):
        return -x

    return f


def order(h, error):
    return np.polyfit(np.log(h), np.log(error), 1)[0]


def test_tide_converges_with_order_one_in_state_and_impulse():
    case = nsbench.get_case("tide")
    steps = 0.05 / np.array(
        [1, 2, 3, 5, 8, 13, 21, 34, 55, 89, 144]
    )  # 7.2 octaves, no dyadic ratio
    runs = [nsbench.solve(case, "catching_up", h=h) for h in steps]
    assert all(r.status.ok and r.stats["loop"] == "compiled" for r in runs)
    state = [np.abs(r.x - case.exact(r.t)).max() for r in runs]
    impulse = [np.abs(r.impulse - case.exact_impulse(r.t)).max() for r in runs]
    assert order(steps, state) == pytest.approx(1.0, abs=0.05)
    assert order(steps, impulse) == pytest.approx(1.0, abs=0.05)


def step_by_cvxpy(x, z, radius=1.0):
    """The QP of one step written down anew: all pairs, no lists; (y, reaction)."""
    import cvxpy as cp

    p = x.reshape(-1, 2)
    y = cp.Variable(x.size)
    rows = []
    for i in range(len(p)):
        for j in range(i + 1, len(p)):
            e = p[i] - p[j]
            r = np.linalg.norm(e)
            a = np.zeros(x.size)
            a[2 * i : 2 * i + 2] = e / r
            a[2 * j : 2 * j + 2] = -e / r
            rows.append(r - 2 * radius + a @ (y - x) >= 0)
    cp.Problem(cp.Minimize(0.5 * cp.sum_squares(y - z)), rows).solve(
        cp.CLARABEL, tol_gap_abs=1e-12, tol_gap_rel=1e-12, tol_feas=1e-12
    )
    duals = [float(c.dual_value) for c in rows]
    return y.value, duals


@pytest.mark.long
@pytest.mark.parametrize("spec", ACCURATE)
@pytest.mark.parametrize("seed", range(4))
def test_one_step_is_the_projection_cvxpy_finds(spec, seed):
    rng = np.random.default_rng(seed)
    x0 = 2.1 * np.stack(np.divmod(np.arange(9), 3), 1).ravel() + rng.uniform(-0.05, 0.05, 18)
    speed = 3.0 * rng.normal(size=18) - 2.0 * (x0 - 2.1)

    def push(xp):
        def f(t, x):
            return speed + 0.0 * x

        return f

    case = Case(
        "one_step", Complementarity(push, (Distance(2.0),)), x0, np.array([0.0, 0.1]), start="keep"
    )
    run = nsbench.solve(case, spec, h=0.1)
    y, duals = step_by_cvxpy(x0, x0 + 0.1 * speed)
    assert len(run.contacts) >= 6
    assert run.x[-1] == pytest.approx(y, abs=1e-8)
    assert run.reaction[-1] == pytest.approx(y - x0 - 0.1 * speed, abs=1e-8)
    assert run.impulse[-1].sum() == pytest.approx(sum(duals), abs=1e-6)
    assert run.impulse[-1].min() >= -1e-12


@pytest.mark.parametrize("h", [0.3, 0.02])
def test_no_pair_left_out_of_the_lists_matters(h):
    case = nsbench.get_case("discs", n=12, seed=4)
    runs = [nsbench.solve(case, f"catching_up[reach={r}]", h=h) for r in (1e-3, 0.3, 100.0)]
    assert runs[2].stats["rebuilds"] == 1 and runs[0].stats["rebuilds"] > 1
    assert runs[2].stats["contacts_peak"] == 66
    for r in runs[:2]:
        assert r.status.ok and r.contacts == runs[2].contacts
        assert r.x == pytest.approx(runs[2].x, abs=1e-9)


def test_three_discs_converge_to_a_finer_run():
    case = nsbench.get_case("discs", n=3)
    fine = nsbench.solve(case, "catching_up", h=0.15 / 4096)
    steps = 0.15 / np.array([2, 3, 5, 8, 13, 21, 34])
    error = [np.abs(nsbench.solve(case, "catching_up", h=h).x - fine.x).max() for h in steps]
    assert order(steps, error) == pytest.approx(1.0, abs=0.15)


def test_rounds_are_counted_once():
    """Pushed onto a wall: the first step finds that it acts in two rounds, the others in one."""
    push = lambda xp: lambda t, x: 0.0 * x - 1.0
    problem = Complementarity(push, (Affine(np.eye(1), np.zeros(1)),))
    case = Case("push", problem, np.zeros(1), np.linspace(0.0, 1.0, 3))
    stats = nsbench.solve(case, "catching_up", h=0.1).stats
    assert stats["qp_solves"] == stats["steps"] == 10
    assert stats["inner_iterations"] == 11 and stats["rounds_worst"] == 2


def test_the_nonlinear_projection_lies_in_the_set_and_is_stationary():
    case = nsbench.get_case("discs", n=6, seed=2)
    run = nsbench.solve(case, "catching_up[nonlinear=true]", h=0.02)
    p = run.x.reshape(len(run.t), -1, 2)
    gap = np.linalg.norm(p[:, :, None] - p[:, None], axis=-1)[:, *np.triu_indices(6, 1)] - 2.0
    assert run.status.ok and run.stats["kkt"] < 1e-10
    assert gap.min() >= -1e-11 and len(run.contacts) >= 6


def test_the_nonlinear_projection_bears_strong_tension():
    case = nsbench.get_case("chain[hanging=rest]")
    run = nsbench.solve(
        case, "catching_up[nonlinear=true]", h=0.05
    )  # plain successive linearisation goes to and fro
    assert run.status.ok and run.x == pytest.approx(case.exact(run.t), abs=1e-8)


def test_a_smooth_family_is_the_affine_one():
    def g(xp):
        def f(t, x):
            return x - 0.1 * xp.sin(t)

        return f

    def b(xp):
        def f(t):
            return -0.1 * xp.sin(t) * xp.ones(1)

        return f

    t = np.linspace(0.0, 1.0, 3)
    runs = [
        nsbench.solve(
            Case("s", Complementarity(pull, (c,)), np.array([0.4]), t), "catching_up", h=0.01
        )
        for c in (Smooth(g, gradient=lambda xp: lambda t, x: xp.ones((1, 1))), Affine(np.eye(1), b))
    ]
    assert [r.stats["loop"] for r in runs] == ["host", "compiled"]
    assert runs[0].x == pytest.approx(runs[1].x, abs=1e-14) and runs[0].impulse == pytest.approx(
        runs[1].impulse, abs=1e-14
    )


@pytest.mark.long
def test_failures_are_statuses():
    def blow(xp):
        def f(t, x):
            return x / (0.5 - t) if t < 0.5 else x * xp.inf

        return f

    floor = (Affine(np.eye(1), np.zeros(1)),)
    run = nsbench.solve(
        Case("b", Complementarity(blow, floor), np.ones(1), np.linspace(0, 1, 5)),
        "catching_up",
        h=0.05,
    )
    assert run.status.code == "nan" and np.isfinite(run.x[1]).all() and np.isnan(run.x[-1]).all()
    at = Case(
        "c",
        Complementarity(still, (Distance(1.0),)),
        np.zeros(4),
        np.linspace(0, 1, 3),
        start="keep",
    )
    for spec in ACCURATE:
        assert nsbench.solve(at, spec, h=0.1).status.code == "degenerate"
    assert nsbench.solve(
        "wheel", "catching_up", h=0.05
    ).status.ok  # starts at the hub, far inside its link


def test_refusals_and_options():
    for name in ("sliding", "smooth"):
        why = get("catching_up").refuses(nsbench.get_case(name))
        assert why.endswith(".") and "Catching up" in why
    for bad in (
        "backend=osqq",
        "nonlinear=3",
        "eps=1e-3",
        "backend=osqp,eps=2",
        "reach=0",
        "backend=piqp,max_iter=0",
    ):
        with pytest.raises(ValueError):
            get(f"catching_up[{bad}]")
    with pytest.raises(ValueError, match="did you mean 'osqp'"):
        get("catching_up[backend=osqq]")


def test_nonlinear_steps_that_do_not_settle_end_the_run(monkeypatch):
    """A disc dragged round another: one linearisation a step is not enough, and twenty such steps
    are."""
    from nsbench.solvers.catching_up import host_loop

    case = nsbench.get_case("two_discs")
    assert nsbench.solve(case, "catching_up[nonlinear=true]", h=0.01).status.ok
    monkeypatch.setattr(host_loop, "MAX_LINEARISATIONS", 1)
    traj = nsbench.solve(case, "catching_up[nonlinear=true]", h=0.01)
    assert (
        traj.status.code == "maxiter"
        and "did not settle" in str(traj.status)
        and traj.stats["limits"] == host_loop.MAX_UNSETTLED_STEPS
    )
