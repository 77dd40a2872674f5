"""The least-distance problem of a step is solved to rounding by every phase of the active set,
whatever the rank of its rows."""

import numpy as np
import pytest

from nsbench.compilation.decorators import python_entry
from nsbench.solvers.catching_up import qp_backends


def csr(G):
    from scipy.sparse import csr_array

    G = csr_array(G)
    return G.indptr.astype(np.int64), G.indices.astype(np.int64), G.data.astype(float)


def least_distance(G, q):
    """min |d|, q + G d >= 0 by non-negative least squares (Lawson & Hanson 1974, chapter 23); None
    if infeasible."""
    from scipy.optimize import nnls

    E = np.vstack([G.T, -q])
    f = np.append(np.zeros(G.shape[1]), 1.0)
    r = E @ nnls(E, f)[0] - f
    return None if np.linalg.norm(r) < 1e-9 else -r[:-1] / r[-1]


def random_problem(rng):
    """Degenerate on purpose: duplicates, integer rows, more rows than dimensions,
    contradictions."""
    n = rng.integers(1, 8)
    m = rng.integers(1, 24)
    kind = rng.integers(3)
    G = rng.normal(size=(m, n)) if kind == 0 else rng.integers(-2, 3, size=(m, n)).astype(float)
    if kind == 2:
        G = rng.normal(size=(max(1, m // 3), n))[rng.integers(0, max(1, m // 3), m)] * rng.uniform(
            0.1, 10, (m, 1)
        )
    G = G[np.abs(G).sum(1) > 0]
    feasible = -G @ rng.normal(size=n) + np.where(rng.random(len(G)) < 0.5, 0.0, rng.random(len(G)))
    return G, feasible if rng.random() < 0.7 else rng.integers(-2, 3, len(G)).astype(float)


def test_the_active_set_solves_degenerate_problems_from_any_start():
    from nsbench.qp.kernels import active_set

    rng = np.random.default_rng(5)
    contradictions = 0
    for _ in range(300):
        G, q = random_problem(rng)
        if not len(G):
            continue
        ptr, cols, vals = csr(G)
        P = active_set.pattern(ptr, cols, G.shape[1])
        d0 = least_distance(G, q)
        contradictions += d0 is None
        for guess in (
            np.zeros(len(q)),
            np.maximum(-q, 0.0),
            np.ones(len(q)),
            rng.normal(size=len(q)),
        ):
            mu, d, code, _ = active_set.solve(P, vals, q, guess, 1.0)
            assert code == (active_set.INFEASIBLE if d0 is None else active_set.SOLVED)
            if d0 is not None:
                assert d == pytest.approx(d0, abs=1e-9 * (1 + np.abs(d0).max()))
                assert active_set.residual(P, vals, q, mu, d) < 1e-11 * (1 + np.abs(d0).max())
                assert mu.min() >= 0 and np.linalg.matrix_rank(G[mu > 0]) == (mu > 0).sum()
    assert contradictions > 20


def test_every_phase_alone_finds_the_same_point():
    from nsbench.linalg import sparse_ldl
    from nsbench.qp.kernels import active_set, dual_active_set

    lengths = python_entry(sparse_ldl.lengths)
    newton_method = python_entry(active_set.newton)
    drop_dependent = python_entry(dual_active_set.reduce_to_independent_rows)
    goldfarb_idnani = python_entry(dual_active_set.dual_active_set)

    rng = np.random.default_rng(6)
    solved = 0
    reached = 0
    for _ in range(200):
        G, q = random_problem(rng)
        d0 = least_distance(G, q) if len(G) else None
        if d0 is None:
            continue
        solved += 1
        (ptr, cols, vals), m = csr(G), len(q)
        P = active_set.pattern(ptr, cols, G.shape[1])
        common = (P, vals, q, lengths(P, vals), 1.0)
        for newton in (False, True):
            on = np.zeros(m, bool)
            mu = np.zeros(m)
            d = np.zeros(G.shape[1])
            w = np.empty(m)
            slot = np.empty(m, np.int64)
            if newton:
                newton_method(on, *common, mu, d, w, slot)
                before = G.T @ mu
                reached += np.abs(before - d0).max() < 1e-6 * (1 + np.abs(d0).max())
                assert (
                    mu.min() >= 0 and q @ mu + 0.5 * before @ before <= 0.0
                )  # the dual value has fallen
                drop_dependent(on, P, vals, mu, common[3], slot)
                assert mu.min() >= 0 and G.T @ mu == pytest.approx(
                    before, abs=1e-9 * (1 + np.abs(d0).max())
                )
                assert np.linalg.matrix_rank(G[mu > 0]) == (mu > 0).sum()
            assert (
                goldfarb_idnani(on, *common, mu, d, w, slot)[0]
                == dual_active_set.SOLVED
            )
            assert d == pytest.approx(d0, abs=1e-9 * (1 + np.abs(d0).max()))
    assert solved > 100 and reached > 0.9 * solved  # it has 100 rounds


def test_the_sparse_factor_is_the_dense_one_in_an_order_that_fills_little():
    from nsbench.linalg import sparse_ldl

    back, choose, factor = (
        python_entry(k) for k in (sparse_ldl.back, sparse_ldl.choose, sparse_ldl.factor)
    )
    from nsbench.qp.kernels import active_set

    rng = np.random.default_rng(0)
    side = 30
    m = side * side
    k = np.arange(m)
    right = k[k % side < side - 1]
    below = k[k < m - side]
    ends = np.concatenate([np.stack([right, right + 1], 1), np.stack([below, below + side], 1)])
    G = np.zeros((m, m + len(ends)))  # rows: points of a grid; columns: themselves, edges
    G[k, k] = 1.0
    G[ends[:, 0], m + np.arange(len(ends))], G[ends[:, 1], m + np.arange(len(ends))] = rng.normal(
        size=(2, len(ends))
    )
    G = G[rng.permutation(m)]
    ptr, cols, vals = csr(G)
    P = active_set.pattern(ptr, cols, G.shape[1])
    assert np.array_equal(np.sort(P.order), k)
    for on, fill in (
        (np.ones(m, bool), 15 * m),
        (rng.random(m) < 0.5, 2 * m),
    ):  # its natural order fills 30 m
        slot = np.empty(m, np.int64)
        act = choose(on, P.order, slot)
        L, D = factor(act, slot, ptr, cols, vals, P.tptr, P.trow, P.tpos, 1e-12, 0.0)
        assert np.array_equal(np.sort(act), np.flatnonzero(on)) and D.min() > 0
        b = rng.normal(size=act.size)
        x = b.copy()
        back(L, D, x)
        assert G[act] @ (G[act].T @ x) == pytest.approx(b, abs=1e-9)
        assert L[0][-1] < fill


def test_the_residual_catches_a_false_answer():
    from nsbench.qp.kernels import active_set

    G = np.array([[1.0, 0.0], [3.0, 4.0], [0.0, 2.0]])
    q = np.array([-1.0, -15.0, 2.0])
    ptr, cols, vals = csr(G)
    P = active_set.pattern(ptr, cols, 2)
    mu, d, code, _ = active_set.solve(P, vals, q, np.zeros(3), 1.0)
    assert code == active_set.SOLVED and (mu > 0).sum() == 1

    def judged(mu, d):
        from scipy.sparse import csr_array

        here = qp_backends.residual(csr_array(G), q + G @ d, mu, d)
        assert active_set.residual(P, vals, q, mu, d) == pytest.approx(here, abs=1e-15, nan_ok=True)
        return here

    k = int(np.argmax(mu))
    e = np.eye(3)[k]
    assert judged(mu, d) < 1e-14
    assert judged(mu + 1e-3 * e, d) == pytest.approx(1e-3 * np.abs(G[k]).max())  # stationarity
    assert judged(-mu, -d) > 0.1  # OSQP's sign
    assert judged(0 * mu, 0 * d) == pytest.approx(3.0)  # primal: 15 / 5
    far = mu + 2e-3 * np.eye(3)[2]
    assert judged(far, G.T @ far) == pytest.approx(4e-3)  # a push where there is a gap
    assert np.isnan(judged(np.nan * mu, d))


def test_the_residual_of_the_kernels_is_the_residual_of_the_host():
    """qp.kernels.active_set.residual and catching_up.qp_backends.residual are one formula."""
    from scipy.sparse import csr_array

    from nsbench.qp.kernels import active_set
    from nsbench.solvers.catching_up.qp_backends import residual

    rng = np.random.default_rng(5)
    G = csr_array(rng.normal(size=(6, 4)) * (rng.random((6, 4)) < 0.7) + np.eye(6, 4))
    q = rng.normal(size=6)
    mu = rng.normal(size=6)
    d = rng.normal(size=4)
    G.data[:] = np.where(G.data == 0.0, 1.0, G.data)
    dense = G.toarray()
    dense[4:, 0] += 2.0  # no empty row
    G = csr_array(dense)
    P = active_set.pattern(G.indptr.astype(np.int64), G.indices.astype(np.int64), 4)
    kernel = active_set.residual(P, G.data, q, mu, d)
    assert kernel == pytest.approx(residual(G, q + G @ d, mu, d), rel=1e-14)
