"""The active set revised row by row ends where the exact one ends, whatever rows it starts from,
and says when it gives up."""

import numpy as np
import pytest
from packings import ready, step

from nsbench.compilation.decorators import python_entry
from nsbench.linalg import multifrontal, sparse_ldl
from nsbench.qp.kernels import active_set, working_set_update
from nsbench.qp.kernels.working_set_update import EXTRA

lengths = python_entry(sparse_ldl.lengths)
workspace = python_entry(multifrontal.workspace)
update_working_set = python_entry(working_set_update.update_working_set)
dual = python_entry(active_set.dual)


def problem(seed, n=70, crystal=False):
    """A step with rows of length 1: pattern, fronts, rows, q, the matrix, and the exact
    displacement and multipliers."""
    G, q = step(np.random.default_rng(seed), n, crystal=crystal, walls=seed % 2 == 0)
    P, T, vals = ready(G)
    norm = lengths(P, vals)
    vals = vals / np.repeat(norm, np.diff(P.ptr))
    q = q / norm
    mu, d, code, _ = active_set.solve(P, vals, q, np.zeros(len(q)), 10.0)
    assert code == active_set.SOLVED
    return P, T, vals, q, mu, d


def run(P, T, vals, q, mu, most=10**6, limit=10**6, tol=1e-12):
    """What revise makes of mu: done, factorisations, exchanges, mu, d and the residual by the
    formula of kernels.qp."""
    mu = mu.copy()
    d = np.zeros(P.tptr.size - 1)
    w = np.zeros(len(q))
    done, factors, swaps = update_working_set(
        P, T, workspace(T), vals, q, mu, tol, most, limit, d, w
    )
    return done, factors, swaps, mu, d, active_set.residual(P, vals, q, mu, d)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(6))
def test_any_start_ends_at_the_exact_displacement(seed):
    P, T, vals, q, exact, d0 = problem(seed, crystal=seed % 3 == 0)
    rng = np.random.default_rng(seed)
    most = 0
    for start in (
        exact,
        np.zeros(len(q)),
        np.where(rng.random(len(q)) < 0.7, exact, 0.0),
        0.1 * rng.random(len(q)),
        np.where(rng.random(len(q)) < 0.1, 0.05, exact),
    ):
        done, _, swaps, mu, d, left = run(P, T, vals, q, start)
        assert done and left <= 1e-12 and mu.min() >= 0.0
        assert d == pytest.approx(d0, abs=1e-10)
        most = max(most, swaps)
    assert most > EXTRA  # some needed more columns than there is room for


def test_the_exact_set_costs_one_factor_and_no_exchange():
    P, T, vals, q, exact, d0 = problem(1)
    done, factors, swaps, _, d, left = run(P, T, vals, q, exact)
    assert (
        done and (factors, swaps) == (1, 0) and left <= 1e-13 and d == pytest.approx(d0, abs=1e-13)
    )


@pytest.mark.parametrize("seed, away", [(1, 10.0), (1, 100.0), (3, 10.0), (3, 100.0)])
def test_one_more_centre_than_the_tolerance_asks_for_brings_the_residual_down_to_rounding(
    seed, away
):
    P, T, vals, q, exact, d0 = problem(seed)
    done, _, _, _, d, left = run(
        P, T, vals, q, away * exact, tol=1e-9
    )  # the right rows, far from the centre
    assert (
        done and left <= 1e-13 and d == pytest.approx(d0, abs=1e-10)
    )  # 5e-11 and more at the centre before


def test_it_gives_up_and_is_no_worse_than_before():
    P, T, vals, q, exact, _ = problem(5)
    start = np.where(np.random.default_rng(0).random(len(q)) < 0.7, exact, 0.0)

    def value(mu):
        d = np.zeros(P.tptr.size - 1)
        return dual(P, vals, q, mu, d)

    done, _, swaps, mu, _, _ = run(P, T, vals, q, start, most=0)
    assert not done and swaps == 0 and np.array_equal(mu, start)
    done, _, swaps, mu, _, left = run(P, T, vals, q, start, limit=5)
    assert not done and swaps == 5 and mu.min() >= 0.0 and value(mu) < value(start) and left > 1e-9
