"""The flow of a linear error and its integral, whatever the size of the derivative."""

import numpy as np
import pytest
from scipy.linalg import expm

from nsbench.error_bars.linear_flow import _flow


@pytest.mark.parametrize("size", [1e-12, 1e-3, 0.9, 3.0, 7.9, 8.1, 60.0])
def test_flow_and_mean_are_those_of_the_matrix_exponential(size):
    rng = np.random.default_rng(5)
    A = rng.standard_normal((6, 6))
    A *= size / np.linalg.norm(A)
    v = rng.standard_normal(6)
    end, mean = _flow(A, size, v)
    whole = expm(A)
    assert np.allclose(end, whole @ v, rtol=0.0, atol=1e-13 * np.linalg.norm(whole))
    # A times the mean is exp(A) v - v
    assert np.allclose(A @ mean, whole @ v - v, rtol=0.0, atol=1e-12 * np.linalg.norm(whole))


def test_a_stiff_error_is_gone_at_once():
    end, mean = _flow(np.diag([-1e9, -1.0]), 1e9, np.ones(2))
    assert end == pytest.approx([0.0, np.exp(-1.0)], abs=1e-12)
    assert mean == pytest.approx([1e-9, 1.0 - np.exp(-1.0)], rel=1e-9)


def test_an_infinite_derivative_is_refused():
    with pytest.raises(ArithmeticError, match="not finite"):
        _flow(np.full((2, 2), np.inf), np.inf, np.ones(2))
