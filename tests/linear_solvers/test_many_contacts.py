"""With many contacts at work the step is solved on fronts: the same point as by the exact active
set, warm or cold."""

import numpy as np
import pytest
from packings import ready, step
from scipy.sparse import csr_array, vstack

from nsbench.compilation.decorators import python_entry
from nsbench.linalg import multifrontal, sparse_ldl
from nsbench.linalg.nested_dissection import LARGEST_FRONT, LEAF
from nsbench.qp.kernels import active_set
from nsbench.qp.kernels import interior_point as by_interior_points

lengths = python_entry(sparse_ldl.lengths)
workspace = python_entry(multifrontal.workspace)
factor = python_entry(multifrontal.factor)
solve = python_entry(multifrontal.solve)
interior_point = python_entry(by_interior_points.interior_point)


def by_fronts(G, q, guess, tol=1e-12):
    P, T, vals = ready(G)
    mu = np.zeros(len(q))
    d = np.zeros(G.shape[1])
    w = np.zeros(len(q))
    norm = lengths(P, vals)
    code, rounds = interior_point(
        P,
        T,
        workspace(T),
        vals / np.repeat(norm, np.diff(P.ptr)),
        q / norm,
        guess * norm,
        10.0,
        tol,
        mu,
        d,
        w,
    )
    mu /= norm
    return code, mu, d, active_set.residual(P, vals, q, mu, d), rounds


@pytest.mark.long
@pytest.mark.parametrize("n", [1, 7, 60, 200])
def test_the_fronts_factor_the_dense_matrix_whatever_the_weights(n):
    rng = np.random.default_rng(n)
    G, _ = step(rng, n)
    P, T, vals = ready(G)
    assert np.array_equal(np.sort(T.order), np.arange(2 * n))
    L, F, stack, work = workspace(T)
    weight = 10.0 ** rng.uniform(-8, 6, G.shape[0]) * (rng.random(G.shape[0]) < 0.7)
    factor(T, P.ptr, vals, weight, L, F, stack)
    b = rng.normal(size=2 * n)
    x = np.empty(2 * n)
    solve(T, L, b, x, work)
    K = np.eye(2 * n) + (G.T @ (weight[:, None] * G.toarray()))
    assert x == pytest.approx(np.linalg.solve(K, b), abs=1e-8)
    assert K @ x == pytest.approx(b, abs=1e-8)


def test_a_chain_is_cut_into_small_fronts():
    """A part of a chain that is not cut any more meets one coordinate on either side."""
    n = 500
    p = np.random.default_rng(3).permutation(n)
    G = np.zeros((n - 1, n))
    k = np.arange(n - 1)
    G[k, p[:-1]] = 1.0
    G[k, p[1:]] = -1.0
    P, T, vals = ready(G)
    assert np.array_equal(np.sort(T.order), np.arange(n))
    assert np.diff(T.first).max() <= LEAF and T.sizes[LARGEST_FRONT] <= LEAF + 2
    L, F, stack, work = workspace(T)
    factor(T, P.ptr, vals, np.ones(n - 1), L, F, stack)
    b = np.sin(np.arange(n))
    x = np.empty(n)
    solve(T, L, b, x, work)
    assert x + G.T @ (G @ x) == pytest.approx(b, abs=1e-13)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(10))
def test_fronts_and_active_set_find_the_same_point(seed):
    rng = np.random.default_rng(seed)
    G, q = step(rng, 70, crystal=seed % 2 == 0, walls=seed % 3 > 0)
    P, _, vals = ready(G)
    code, mu, d, left, _ = by_fronts(G, q, np.zeros(len(q)))
    exact, d0, found, _ = active_set.solve(P, vals, q, np.zeros(len(q)), 10.0)
    assert code == 0 and found == active_set.SOLVED and left <= 1e-12 and (mu > 0).sum() > 70
    assert mu.min() >= 0 and d == pytest.approx(d0, abs=1e-10)
    assert active_set.residual(P, vals, q, exact, d0) < 1e-12


def test_a_crystal_is_pressed_together_from_a_cold_start():
    G, q = step(np.random.default_rng(0), 70, crystal=True)
    P, _, vals = ready(G)
    code, mu, d, left, _ = by_fronts(G, q, np.zeros(len(q)))
    _, d0, found, _ = active_set.solve(P, vals, q, np.zeros(len(q)), 10.0)
    assert code == 0 and found == active_set.SOLVED and left <= 1e-12
    assert mu.min() >= 0.0 and d == pytest.approx(d0, abs=1e-10)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(5))
def test_a_guess_changes_the_work_not_the_answer(seed):
    rng = np.random.default_rng(100 + seed)
    G, q = step(rng, 150, crystal=seed == 0)
    _, mu, d, _, cold = by_fronts(G, q, np.zeros(len(q)))
    for guess in (mu, rng.random(len(q)), np.full(len(q), 10.0), mu * (rng.random(len(q)) < 0.5)):
        code, _, other, left, rounds = by_fronts(G, q, guess)
        assert code == 0 and left <= 1e-12 and other == pytest.approx(d, abs=1e-10)
        if guess is mu:
            assert rounds < cold / 2


@pytest.mark.long
def test_twenty_packings_keep_the_residual():
    for seed in range(20):
        rng = np.random.default_rng(200 + seed)
        G, q = step(rng, int(rng.integers(80, 300)), crystal=seed % 4 == 0)
        code, mu, d, left, _ = by_fronts(G, q, np.zeros(len(q)), tol=1e-10)
        assert code == 0 and left <= 1e-10
        assert np.all(q + G @ d >= -2e-9) and d == pytest.approx(G.T @ mu, abs=1e-14)


def test_walls_that_contradict_each_other_are_infeasible():
    rng = np.random.default_rng(7)
    G, q = step(rng, 100)
    n = G.shape[1]
    ceiling = csr_array(
        (np.full(n // 2, -1.0), (np.arange(n // 2), 2 * np.arange(n // 2) + 1)), shape=(n // 2, n)
    )
    code, _, _, _, _ = by_fronts(
        vstack([G, ceiling]), np.append(q, np.full(n // 2, -50.0)), np.zeros(len(q) + n // 2)
    )
    assert code == 1


def test_a_run_through_both_solvers_is_one_run(monkeypatch):
    """The same run with every step by the active set: state and reaction agree, and the impulses
    balance."""
    import nsbench
    from nsbench.qp import projection
    from nsbench.solvers.catching_up import method

    case = nsbench.get_case("discs", n=60, seed=3)
    own = nsbench.solve(case, "catching_up", h=0.02)
    from nsbench.qp.kernels.dispatch import no_large_solver

    monkeypatch.setattr(method, "large_problem_callback", lambda rows: no_large_solver)
    monkeypatch.setattr(projection, "large_problem_callback", lambda rows: no_large_solver)
    exact = nsbench.solve(case, "catching_up", h=0.02)
    assert own.status.ok and exact.status.ok and own.stats["kkt"] <= 1e-9
    assert own.stats["inner_iterations"] != exact.stats["inner_iterations"]
    early = slice(0, 6)  # before small differences have grown: a cluster closing up
    assert own.x[early] == pytest.approx(exact.x[early], abs=1e-7)
    assert own.reaction[early] == pytest.approx(exact.reaction[early], abs=1e-7)
