"""Catching up solves the QP of every step to rounding, whoever solves it, and says so when it does not."""
import dataclasses

import numpy as np
import pytest

import nsbench
from nsbench import Affine, Case, Complementarity, Distance, Smooth
from nsbench.solvers import _qp, get
from nsbench.solvers.base import grid

ACCURATE = ("catching_up", "catching_up[backend=osqp]", "catching_up[backend=piqp]")


def still(xp):
    def f(t, x):
        return 0.0 * x
    return f


def pull(xp):
    def f(t, x):
        return -x
    return f


def host_twin(case, h, reach=0.3):
    """The run of the active set in the Python loop."""
    from nsbench.contacts import Scene
    from nsbench.solvers._catching_up_host import HostLoop
    from nsbench.solvers.catching_up import _trajectory
    g = grid(case.t, h)
    loop = HostLoop(case, Scene(case.problem, case.n), g, case.x0.copy(), "active_set", False, reach, None, None)
    return _trajectory(case, g, "host", loop.run())


def order(h, error):
    return np.polyfit(np.log(h), np.log(error), 1)[0]


def test_tide_converges_with_order_one_in_state_and_impulse():
    case = nsbench.get_case("tide")
    steps = 0.05 / np.array([1, 2, 3, 5, 8, 13, 21, 34, 55, 89, 144])           # 7.2 octaves, no dyadic ratio
    runs = [nsbench.solve(case, "catching_up", h=h) for h in steps]
    assert all(r.status.ok and r.stats["loop"] == "compiled" for r in runs)
    state = [np.abs(r.x - case.exact(r.t)).max() for r in runs]
    impulse = [np.abs(r.impulse - case.exact_impulse(r.t)).max() for r in runs]
    assert order(steps, state) == pytest.approx(1.0, abs=0.05)
    assert order(steps, impulse) == pytest.approx(1.0, abs=0.05)


def step_by_cvxpy(x, z, radius=1.0):
    """The QP of one step written down anew: all pairs, no lists; (y, reaction)."""
    import cvxpy as cp
    p, y = x.reshape(-1, 2), cp.Variable(x.size)
    rows = []
    for i in range(len(p)):
        for j in range(i + 1, len(p)):
            e = p[i] - p[j]
            r = np.linalg.norm(e)
            a = np.zeros(x.size)
            a[2 * i:2 * i + 2], a[2 * j:2 * j + 2] = e / r, -e / r
            rows.append(r - 2 * radius + a @ (y - x) >= 0)
    cp.Problem(cp.Minimize(0.5 * cp.sum_squares(y - z)), rows).solve(
        cp.CLARABEL, tol_gap_abs=1e-12, tol_gap_rel=1e-12, tol_feas=1e-12)
    duals = [float(c.dual_value) for c in rows]
    return y.value, duals


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
    case = Case("one_step", Complementarity(push, (Distance(2.0),)), x0, np.array([0.0, 0.1]), start="keep")
    run = nsbench.solve(case, spec, h=0.1)
    y, duals = step_by_cvxpy(x0, x0 + 0.1 * speed)
    assert len(run.contacts) >= 6
    assert run.x[-1] == pytest.approx(y, abs=1e-8)
    assert run.reaction[-1] == pytest.approx(y - x0 - 0.1 * speed, abs=1e-8)
    assert run.impulse[-1].sum() == pytest.approx(sum(duals), abs=1e-6)
    assert run.impulse[-1].min() >= -1e-12


def csr(G):
    from scipy.sparse import csr_array
    G = csr_array(G)
    return G.indptr.astype(np.int64), G.indices.astype(np.int64), G.data.astype(float)


def least_distance(G, q):
    """min |d|, q + G d >= 0 by non-negative least squares (Lawson & Hanson 1974, chapter 23); None if infeasible."""
    from scipy.optimize import nnls
    E, f = np.vstack([G.T, -q]), np.append(np.zeros(G.shape[1]), 1.0)
    r = E @ nnls(E, f)[0] - f
    return None if np.linalg.norm(r) < 1e-9 else -r[:-1] / r[-1]


def random_problem(rng):
    """Degenerate on purpose: duplicates, integer rows, more rows than dimensions, contradictions."""
    n, m, kind = rng.integers(1, 8), rng.integers(1, 24), rng.integers(3)
    G = rng.normal(size=(m, n)) if kind == 0 else rng.integers(-2, 3, size=(m, n)).astype(float)
    if kind == 2:
        G = rng.normal(size=(max(1, m // 3), n))[rng.integers(0, max(1, m // 3), m)] * rng.uniform(0.1, 10, (m, 1))
    G = G[np.abs(G).sum(1) > 0]
    feasible = -G @ rng.normal(size=n) + np.where(rng.random(len(G)) < 0.5, 0.0, rng.random(len(G)))
    return G, feasible if rng.random() < 0.7 else rng.integers(-2, 3, len(G)).astype(float)


def test_the_active_set_solves_degenerate_problems_from_any_start():
    from nsbench.kernels import qp
    rng, contradictions = np.random.default_rng(5), 0
    for _ in range(300):
        G, q = random_problem(rng)
        if not len(G):
            continue
        ptr, cols, vals = csr(G)
        P, d0 = qp.pattern(ptr, cols, G.shape[1]), least_distance(G, q)
        contradictions += d0 is None
        for guess in (np.zeros(len(q)), np.maximum(-q, 0.0), np.ones(len(q)), rng.normal(size=len(q))):
            mu, d, code, _ = qp.solve(P, vals, q, guess, 1.0)
            assert code == (qp.INFEASIBLE if d0 is None else qp.SOLVED)
            if d0 is not None:
                assert d == pytest.approx(d0, abs=1e-9 * (1 + np.abs(d0).max()))
                assert qp.residual(P, vals, q, mu, d) < 1e-11 * (1 + np.abs(d0).max())
                assert mu.min() >= 0 and np.linalg.matrix_rank(G[mu > 0]) == (mu > 0).sum()
    assert contradictions > 20


def test_every_phase_alone_finds_the_same_point():
    from nsbench.kernels import pivot, qp
    from nsbench.kernels.sparse import lengths
    rng, solved, reached = np.random.default_rng(6), 0, 0
    for _ in range(200):
        G, q = random_problem(rng)
        d0 = least_distance(G, q) if len(G) else None
        if d0 is None:
            continue
        solved += 1
        (ptr, cols, vals), m = csr(G), len(q)
        P = qp.pattern(ptr, cols, G.shape[1])
        common = (P, vals, q, lengths(P, vals), 1.0)
        for newton in (False, True):
            on, mu, d, w, slot = np.zeros(m, bool), np.zeros(m), np.zeros(G.shape[1]), np.empty(m), np.empty(m, np.int64)
            if newton:
                qp.newton(on, *common, mu, d, w, slot)
                before = G.T @ mu
                reached += np.abs(before - d0).max() < 1e-6 * (1 + np.abs(d0).max())
                assert mu.min() >= 0 and q @ mu + 0.5 * before @ before <= 0.0          # the dual value has fallen
                pivot.purify(on, P, vals, mu, common[3], slot)
                assert mu.min() >= 0 and G.T @ mu == pytest.approx(before, abs=1e-9 * (1 + np.abs(d0).max()))
                assert np.linalg.matrix_rank(G[mu > 0]) == (mu > 0).sum()
            assert pivot.one_by_one(on, *common, mu, d, w, slot)[0] == pivot.SOLVED
            assert d == pytest.approx(d0, abs=1e-9 * (1 + np.abs(d0).max()))
    assert solved > 100 and reached > 0.9 * solved               # it has 100 rounds


def test_the_sparse_factor_is_the_dense_one_in_an_order_that_fills_little():
    from nsbench.kernels import qp
    from nsbench.kernels.sparse import back, choose, factor
    rng, side = np.random.default_rng(0), 30
    m = side * side
    k = np.arange(m)
    right, below = k[k % side < side - 1], k[k < m - side]
    ends = np.concatenate([np.stack([right, right + 1], 1), np.stack([below, below + side], 1)])
    G = np.zeros((m, m + len(ends)))                              # rows: points of a grid; columns: themselves, edges
    G[k, k] = 1.0
    G[ends[:, 0], m + np.arange(len(ends))], G[ends[:, 1], m + np.arange(len(ends))] = rng.normal(size=(2, len(ends)))
    G = G[rng.permutation(m)]
    ptr, cols, vals = csr(G)
    P = qp.pattern(ptr, cols, G.shape[1])
    assert np.array_equal(np.sort(P[5]), k)
    for on, fill in ((np.ones(m, bool), 15 * m), (rng.random(m) < 0.5, 2 * m)):     # its natural order fills 30 m
        slot = np.empty(m, np.int64)
        act = choose(on, P[5], slot)
        L, D = factor(act, slot, ptr, cols, vals, P[2], P[3], P[4], 1e-12, 0.0)
        assert np.array_equal(np.sort(act), np.flatnonzero(on)) and D.min() > 0
        b = rng.normal(size=act.size)
        x = b.copy()
        back(L, D, x)
        assert G[act] @ (G[act].T @ x) == pytest.approx(b, abs=1e-9)
        assert L[0][-1] < fill


def test_the_residual_catches_a_false_answer():
    from nsbench.kernels import qp
    G, q = np.array([[1.0, 0.0], [3.0, 4.0], [0.0, 2.0]]), np.array([-1.0, -15.0, 2.0])
    ptr, cols, vals = csr(G)
    P = qp.pattern(ptr, cols, 2)
    mu, d, code, _ = qp.solve(P, vals, q, np.zeros(3), 1.0)
    assert code == qp.SOLVED and (mu > 0).sum() == 1

    def judged(mu, d):
        from scipy.sparse import csr_array
        here = _qp.residual(csr_array(G), q + G @ d, mu, d)
        assert qp.residual(P, vals, q, mu, d) == pytest.approx(here, abs=1e-15, nan_ok=True)
        return here
    k = int(np.argmax(mu))
    e = np.eye(3)[k]
    assert judged(mu, d) < 1e-14
    assert judged(mu + 1e-3 * e, d) == pytest.approx(1e-3 * np.abs(G[k]).max())            # stationarity
    assert judged(-mu, -d) > 0.1                                                           # OSQP's sign
    assert judged(0 * mu, 0 * d) == pytest.approx(3.0)                                     # primal: 15 / 5
    far = mu + 2e-3 * np.eye(3)[2]
    assert judged(far, G.T @ far) == pytest.approx(4e-3)                                   # a push where there is a gap
    assert np.isnan(judged(np.nan * mu, d))


class Liar(_qp.ActiveSet):
    """Says solved, with multipliers a thousandth too large."""

    def __call__(self, *args):
        return dataclasses.replace(a, mu=1.001 * a.mu) if (a := super().__call__(*args)) else a


def test_a_backend_that_claims_success_falsely_is_unverified(monkeypatch):
    case = nsbench.get_case("tide")
    monkeypatch.setitem(_qp.BACKENDS, "osqp", Liar)
    run = nsbench.solve(case, "catching_up[backend=osqp]", h=0.05)
    assert run.status.code == "unverified" and "KKT residual" in str(run.status) and run.stats["kkt"] > 1e-6


def test_an_iteration_limit_is_counted_and_shown():
    run = nsbench.solve("discs[n=3]", "catching_up[backend=osqp,max_iter=1]", h=0.05)
    assert run.stats["limits"] > 5 and run.status.code == "unverified"


def test_backends_and_loops_agree_on_multipliers():
    case = nsbench.get_case("three_discs")
    own = nsbench.solve(case, "catching_up", h=0.02)
    twin = host_twin(case, 0.02)
    assert own.stats["loop"] == "compiled" and twin.stats["loop"] == "host"
    assert own.contacts == twin.contacts and own.status.ok
    assert twin.x == pytest.approx(own.x, abs=1e-12) and twin.impulse == pytest.approx(own.impulse, abs=1e-11)
    for spec in ACCURATE[1:]:
        other = nsbench.solve(case, spec, h=0.02)
        at = [other.contacts.index(c) for c in own.contacts]
        assert other.x == pytest.approx(own.x, abs=1e-8)
        assert other.impulse[:, at] == pytest.approx(own.impulse, abs=1e-6)
        assert own.impulse[-1].max() > 0.1


def everything():
    """Discs, moving walls, links, a moving anchor: every kind of constraint at once."""
    rng = np.random.default_rng(3)
    x0 = 2.2 * np.stack(np.divmod(np.arange(9), 3), 1).ravel() + rng.uniform(-0.05, 0.05, 18)
    eye = np.eye(18)

    def walls(xp):
        def b(t):
            return xp.concatenate((xp.full(18, 0.3) + 0.2 * xp.sin(t), xp.full(18, 4.8) - 0.3 * t))
        return b

    def hook(xp):
        def a(t):
            return xp.array([[1.0, 0.0]]) * xp.cos(t) + xp.array([[-2.0, 2.0]])
        return a

    def nail(xp):
        def a(t):
            return xp.array([[5.5, 0.0]]) * xp.cos(0.1 * t)
        return a

    def f(xp):
        def g(t, x):
            return xp.cos(3.0 * t) * (2.0 - x) + xp.sin(xp.arange(18.0) + t)
        return g
    families = (Distance(2.0), Affine(np.vstack([eye, -eye]), walls), Distance(2.1, sign=-1, pairs=[[0, 1], [4, 5]]),
                Distance(1.5, sign=-1, pairs=[[6, 0]], anchors=nail), Distance(1.0, anchors=hook))
    return Case("everything", Complementarity(f, families), x0, np.linspace(0.0, 1.0, 5), start="keep")


def test_the_compiled_loop_is_the_loop_in_python_for_every_family():
    case = everything()
    own, twin = nsbench.solve(case, "catching_up", h=0.01), host_twin(case, 0.01)
    assert own.status.ok and own.stats["loop"] == "compiled" and {c[0] for c in own.contacts} >= {0, 1, 2, 3}
    assert own.contacts == twin.contacts
    assert twin.x == pytest.approx(own.x, abs=1e-11) and twin.impulse == pytest.approx(own.impulse, abs=1e-10)
    assert own.reaction == pytest.approx(twin.reaction, abs=1e-11)


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


@pytest.mark.parametrize("spec", ACCURATE)
def test_redundant_contacts_have_the_unique_reaction(spec):
    run, case = nsbench.solve("hex[n=19]", spec, h=0.01), nsbench.get_case("hex[n=19]")
    late = run.t > 0.5
    assert run.status.ok and len(run.contacts) >= 30
    fall = np.gradient(run.reaction[late], run.t[late], axis=0)[1:-1]
    assert fall == pytest.approx(np.broadcast_to(case.exact(run.t)[-1], fall.shape), abs=1e-6)
    both = nsbench.solve("duplicate", spec, h=0.01)
    assert both.status.ok and both.impulse.min() >= -1e-12


@pytest.mark.parametrize("spec", ACCURATE)
def test_contradicting_walls_are_infeasible_from_then_on(spec):
    def walls(xp):
        def b(t):
            return xp.stack((-t, 1.0 + 0.0 * t))                   # t <= x <= 1
        return b
    case = Case("press", Complementarity(still, (Affine(np.array([[1.0], [-1.0]]), walls),)), np.array([0.5]),
                np.linspace(0.0, 2.0, 5))
    run = nsbench.solve(case, spec, h=0.1)
    assert run.status.code == "infeasible" and "t = 1" in str(run.status)
    assert run.x[:3, 0] == pytest.approx([0.5, 0.5, 1.0]) and np.all(np.isnan(run.x[3:])) and np.all(np.isnan(run.impulse[3:]))


def test_the_nonlinear_projection_lies_in_the_set_and_is_stationary():
    case = nsbench.get_case("discs", n=6, seed=2)
    run = nsbench.solve(case, "catching_up[nonlinear=true]", h=0.02)
    p = run.x.reshape(len(run.t), -1, 2)
    gap = np.linalg.norm(p[:, :, None] - p[:, None], axis=-1)[:, *np.triu_indices(6, 1)] - 2.0
    assert run.status.ok and run.stats["kkt"] < 1e-10
    assert gap.min() >= -1e-11 and len(run.contacts) >= 6


def test_the_nonlinear_projection_bears_strong_tension():
    case = nsbench.get_case("chain[hanging=rest]")
    run = nsbench.solve(case, "catching_up[nonlinear=true]", h=0.05)    # plain successive linearisation goes to and fro
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
    runs = [nsbench.solve(Case("s", Complementarity(pull, (c,)), np.array([0.4]), t), "catching_up", h=0.01)
            for c in (Smooth(g, gradient=lambda xp: lambda t, x: xp.ones((1, 1))), Affine(np.eye(1), b))]
    assert [r.stats["loop"] for r in runs] == ["host", "compiled"]
    assert runs[0].x == pytest.approx(runs[1].x, abs=1e-14) and runs[0].impulse == pytest.approx(runs[1].impulse, abs=1e-14)


def test_failures_are_statuses():
    def blow(xp):
        def f(t, x):
            return x / (0.5 - t) if t < 0.5 else x * xp.inf
        return f
    floor = (Affine(np.eye(1), np.zeros(1)),)
    run = nsbench.solve(Case("b", Complementarity(blow, floor), np.ones(1), np.linspace(0, 1, 5)), "catching_up", h=0.05)
    assert run.status.code == "nan" and np.isfinite(run.x[1]).all() and np.isnan(run.x[-1]).all()
    at = Case("c", Complementarity(still, (Distance(1.0),)), np.zeros(4), np.linspace(0, 1, 3), start="keep")
    for spec in ACCURATE:
        assert nsbench.solve(at, spec, h=0.1).status.code == "degenerate"
    assert nsbench.solve("wheel", "catching_up", h=0.05).status.ok          # starts at the hub, far inside its link


def test_refusals_and_options():
    for name in ("sliding", "smooth"):
        why = get("catching_up").refuses(nsbench.get_case(name))
        assert why.endswith(".") and "Catching up" in why
    for bad in ("backend=osqq", "nonlinear=3", "eps=1e-3", "backend=osqp,eps=2", "reach=0", "backend=piqp,max_iter=0"):
        with pytest.raises(ValueError):
            get(f"catching_up[{bad}]")
    with pytest.raises(ValueError, match="did you mean 'osqp'"):
        get("catching_up[backend=osqq]")
