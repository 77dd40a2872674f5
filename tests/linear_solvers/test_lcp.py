"""Small complementarity problems are solved to rounding whatever their rank, and unsolvable ones
are told apart."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from nsbench.lcp import lemke
from nsbench.lcp.gram_lcp import INFEASIBLE, OK, in_span, solve_lcp

DEPENDENT = 1e-10


def solve(G, h, warm=()):
    return solve_lcp(
        G @ G.T,
        h,
        np.array(warm, np.int64),
        np.full(len(h), 1e-13 * (1 + np.abs(h).max())),
        DEPENDENT,
    )


def contacts(seed, m, n, rank):
    """m rows in n dimensions of at most that rank, some repeated, some opposite."""
    rng = np.random.default_rng(seed)
    G = rng.standard_normal((m, rank)) @ rng.standard_normal((rank, n))
    G[rng.random(m) < 0.3] = G[0]
    G[rng.random(m) < 0.1] = -G[0]
    return G, rng


problems = st.tuples(
    st.integers(0, 10**6), st.integers(1, 14), st.integers(1, 8), st.integers(1, 8)
)


@pytest.mark.long
@settings(max_examples=300, deadline=None, derandomize=True, database=None)
@given(problems)
@example((2153, 12, 5, 5))  # an opposite row that is off by rounding is not a contradiction
def test_random_problems_of_any_rank_meet_their_conditions(p):
    seed, m, n, rank = p
    G, rng = contacts(seed, m, n, min(rank, n))
    h = G @ rng.standard_normal(n)
    lam, w, support, code, _, _ = solve(G, h)
    scale = 1 + np.abs(h).max()
    assert code == OK
    assert (
        np.all(lam >= 0)
        and np.all(w >= -1e-11 * scale)
        and np.abs(lam * w).max() <= 1e-10 * scale**2
    )
    np.testing.assert_allclose(w, h + G @ (G.T @ lam), atol=1e-11 * scale)
    assert set(np.flatnonzero(lam)) <= set(support)
    assert np.linalg.matrix_rank(G[support], tol=1e-7) == len(support), "the solution is basic"


@settings(max_examples=100, deadline=None, derandomize=True, database=None)
@given(problems)
def test_the_velocity_is_that_of_another_method(p):
    """Non-negative least squares of SciPy on G itself, not on its Gram matrix."""
    from scipy.optimize import nnls

    seed, m, n, rank = p
    G, rng = contacts(seed, m, n, min(rank, n))
    f = rng.standard_normal(n)
    lam = solve(G, G @ f)[0]
    np.testing.assert_allclose(
        f + G.T @ lam, f + G.T @ nnls(G.T, -f)[0], atol=1e-9 * (1 + np.abs(G).max())
    )


@settings(max_examples=100, deadline=None, derandomize=True, database=None)
@given(problems, st.integers(0, 2**14))
def test_a_warm_start_changes_the_way_not_the_velocity(p, bits):
    seed, m, n, rank = p
    G, rng = contacts(seed, m, n, min(rank, n))
    h = G @ rng.standard_normal(n)
    cold = solve(G, h)[0]
    warm = solve(G, h, [k for k in range(m) if bits >> k & 1])[0]
    np.testing.assert_allclose(G.T @ warm, G.T @ cold, atol=1e-9 * (1 + np.abs(h).max()))


@settings(max_examples=100, deadline=None, derandomize=True, database=None)
@given(problems)
def test_moving_walls_are_kept_apart_or_called_infeasible(p):
    """h outside the range of G: feasible exactly if a velocity exists; linear programming is the
    judge."""
    from scipy.optimize import linprog

    seed, m, n, rank = p
    G, rng = contacts(seed, m, n, min(rank, n))
    h = np.round(G @ rng.standard_normal(n) + 0.3 * rng.standard_normal(m), 3)
    best = linprog(
        np.append(np.zeros(n), -1.0),
        A_ub=np.hstack((-G, np.ones((m, 1)))),
        b_ub=h,
        bounds=[(None, None)] * n + [(None, 1.0)],
        method="highs",
    ).x[-1]
    if abs(best) < 1e-4:
        return  # too close for the judge
    lam, w, _, code, bad, _ = solve(G, h)
    assert code == (OK if best > 0 else INFEASIBLE)
    if code == OK:
        scale = (1 + np.abs(h).max()) * (1 + lam.max())
        assert np.all(w >= -1e-10 * scale) and np.abs(lam * w).max() <= 1e-9 * scale**2
    else:
        assert 0 <= bad < m


def test_a_row_of_rods_carries_a_parabola():
    N = 60
    G = np.diff(np.eye(N), axis=0)
    x = np.arange(N) - (N - 1) / 2
    lam, _, support, code, _, iterations = solve(G, -G @ x)
    k = np.arange(1, N)
    assert code == OK and len(support) == N - 1
    np.testing.assert_allclose(lam, k * (N - k) / 2, rtol=1e-11)
    assert iterations <= 2 * N


def test_twice_the_same_wall_is_loaded_once_in_all():
    lam, w, support, code, _, _ = solve(np.ones((2, 1)), -np.ones(2))
    assert code == OK and len(support) == 1
    assert lam.sum() == pytest.approx(1.0, abs=1e-15) and np.abs(w).max() < 1e-15


def test_dependent_rows_are_found():
    G = np.array([[1.0, 0, 0], [0, 1, 0], [1, 1, 0], [0, 0, 1], [2, -3, 0]])
    assert in_span(G @ G.T, np.array([0, 1]), DEPENDENT).tolist() == [True, True, True, False, True]


def test_a_zero_gradient_is_no_way_out():
    *_, code, bad, _ = solve(np.array([[1.0], [0.0]]), np.array([1.0, -1.0]))
    assert code == INFEASIBLE and bad == 1


def by_lemke(M, r):
    """Found, lam; there are too many rows to try all supports where Lemke's method gives up."""
    m = len(r)
    assert m > lemke.ENUMERATED_ROWS
    lam = np.empty(m)
    w = np.empty(m)
    found, _ = lemke.solve(M, r, *lemke.scales(M), np.zeros(m, bool), lam, w)
    return found, lam


@pytest.mark.parametrize("seed", range(6))
def test_many_rows_without_symmetry_are_solved_by_pivots_alone(seed):
    """M is positive definite: there is one solution."""
    rng = np.random.default_rng(seed)
    m = 14
    A, B = rng.normal(size=(2, m, m))
    M = A @ A.T / m + 0.1 * np.eye(m) + B - B.T
    r = rng.normal(size=m)
    found, lam = by_lemke(M, r)
    w = r + M @ lam
    assert found and lam.min() >= 0.0
    assert w.min() >= -1e-13 and np.abs(w * lam).max() <= 1e-13


@pytest.mark.parametrize("turned", [False, True])
def test_of_rows_that_tie_the_artificial_one_leaves(turned):
    """Else the pivots end on a ray, and the solution (1, 0, 0, ...) is missed."""
    M = np.eye(12)
    M[:2, :2] = [[2.0, -1.0], [1.0, -1.0]]
    r = np.array([-2.0, -1.0] + 10 * [1.0])
    way = -1 if turned else 1
    found, lam = by_lemke(M[::way, ::way].copy(), r[::way].copy())
    assert found and lam[::way] == pytest.approx([1.0] + 11 * [0.0], abs=1e-15)
