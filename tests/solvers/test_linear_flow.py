"""The flow of a linear error and its integral, whatever the size of the derivative."""

import numpy as np
import pytest
from scipy.linalg import expm

from nsbench.compilation.decorators import python_entry
from nsbench.error_bars.growth import Linear
from nsbench.error_bars.kernels.split_step import LONG, _fill_flow
from nsbench.error_bars.split_bound import long_flow
from nsbench.error_bars.subspaces import Split


def flow_of(A, H, v):
    """exp(H A) v and its integral over H, as the split bound has them."""
    speed = H * np.linalg.norm(A)
    if speed > LONG:
        return long_flow(A, H, v)
    end = np.empty(len(v))
    mean = np.empty(len(v))
    python_entry(_fill_flow)(A, H, speed, v, end, mean)
    return end, H * mean


@pytest.mark.parametrize("H", [1.0, 0.125])
@pytest.mark.parametrize("size", [1e-12, 1e-3, 0.9, 3.0, 7.9, 8.1, 60.0])
def test_flow_and_integral_are_those_of_the_matrix_exponential(size, H):
    rng = np.random.default_rng(5)
    A = rng.standard_normal((6, 6))
    A *= size / np.linalg.norm(A) / H
    v = rng.standard_normal(6)
    end, integral = flow_of(A, H, v)
    whole = expm(H * A)
    assert np.allclose(end, whole @ v, rtol=0.0, atol=1e-13 * np.linalg.norm(whole))
    # A times the integral is exp(H A) v - v
    off = 1e-12 * np.linalg.norm(whole)
    assert np.allclose(A @ integral, whole @ v - v, rtol=0.0, atol=off)


def test_a_flow_of_nothing_stays():
    end, integral = flow_of(np.zeros((2, 2)), 0.5, np.ones(2))
    assert np.array_equal(end, np.ones(2)) and np.array_equal(integral, np.full(2, 0.5))


def test_a_stiff_error_is_gone_at_once():
    end, integral = flow_of(np.diag([-1e9, -1.0]), 1.0, np.ones(2))
    assert end == pytest.approx([0.0, np.exp(-1.0)], abs=1e-12)
    assert integral == pytest.approx([1e-9, 1.0 - np.exp(-1.0)], rel=1e-9)


def test_an_infinite_derivative_is_refused():
    drift = Linear(np.full((2, 2), np.inf), np.inf, np.inf, np.inf)
    with pytest.raises(ArithmeticError, match="not finite"):
        Split((), np.empty((0, 2)), drift)
