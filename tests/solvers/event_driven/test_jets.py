"""A Jet encloses the Taylor coefficients of a function at every point of its pieces; what it cannot
do it says."""

import jax
import numpy as np
import pytest
from jax.experimental import jet as series

from nsbench.dynamics.interval_taylor import ORDER, SPACE, as_jet, clock, path

MATRIX = np.array([[0.3, -1.2], [0.7, 0.1]])
CALLS = {
    "field": lambda xp, t, x: xp.stack((x[1] * x[0] - 3.0, x[0] / (2.0 + x[1] ** 2))),
    "circular": lambda xp, t, x: xp.sin(3.0 * t) * x + xp.cos(x)[::-1],
    "growth": lambda xp, t, x: xp.exp(-x) + xp.log(2.0 + x * x) + xp.tanh(2 * x),
    "roots": lambda xp, t, x: (
        xp.sqrt(3.0 + x) - (2.5 + x) ** -1.5 + (x + 2.2) ** -2 - 2.0 / (3.0 + x) ** 3
    ),
    "hyperbolic": lambda xp, t, x: (
        xp.sinh(x) * xp.cosh(t) + xp.expm1(x) * xp.log1p(0.1 * xp.cos(t))
    ),
    "angle": lambda xp, t, x: xp.arctan2(x[:1], 3.0 + x[1:]) * xp.ones(2) + xp.arctan(x),
    "matrix": lambda xp, t, x: MATRIX @ x - x @ MATRIX + x.reshape((1, 2)).sum(axis=0) * x.sum(),
    "shapes": lambda xp, t, x: (
        xp.concatenate((x[1:], xp.stack((t, t))))[:2] + xp.zeros_like(x).ravel() + 0.5
    ),
    "norm": lambda xp, t, x: x / xp.linalg.norm(x + 5.0) + xp.hypot(x + 2.5, 1.0),
    "sides": lambda xp, t, x: (
        xp.where(t < 9.0, abs(x + 4.0), -x)
        + xp.maximum(x, -8.0)
        - xp.minimum(t, 7.0)
        + xp.sign(t + 1.0)
    ),
}


def pieces(k=3, width=0.4):
    rng = np.random.default_rng(5)
    centre = np.linspace(0.2, 1.9, k)
    radius = np.full(k, width / 2)
    return rng, centre, radius, 0.5 * rng.normal(size=(2, k, ORDER)) * 0.2 ** np.arange(ORDER)


@pytest.mark.long
@pytest.mark.parametrize("name", CALLS)
def test_every_taylor_coefficient_lies_in_its_enclosure(name):
    """Against another Taylor arithmetic, at random points of each piece."""
    import jax.numpy as jnp

    jax.config.update("jax_enable_x64", True)
    rng, centre, radius, c = pieces()
    out = as_jet(CALLS[name](SPACE, clock(centre, radius), path(c)), 3)
    assert out.shape == (2,) and np.all(np.isfinite(out.rad))
    for k in range(3):
        for s in (-1.0, rng.uniform(-1, 1), 1.0):
            poly = [np.polynomial.Polynomial(row) for row in c[:, k]]
            x = [np.array([p.deriv(j)(s) if j else p(s) for p in poly]) for j in range(ORDER + 1)]
            time = [
                np.array(centre[k] + s * radius[k]),
                np.array(radius[k]),
                *[np.array(0.0)] * (ORDER - 1),
            ]
            if name in ("norm", "angle"):  # functions that series lacks: by nested derivatives
                continue
            f0, fs = series.jet(
                lambda t, x: CALLS[name](jnp, t, x), (time[0], x[0]), (time[1:], x[1:])
            )
            true = np.array([f0, *fs]) / np.cumprod([1, *range(1, ORDER + 1)])[:, None]
            off = np.abs(out.mid[:, k].T - true) - out.rad[:, k].T
            assert off.max() <= 1e-13 * (1 + np.abs(true).max()), (name, k, s)


@pytest.mark.parametrize("name", CALLS)
def test_ranges_hold_all_values_and_the_last_coefficient_bounds_interpolation(name):
    _, centre, radius, c = pieces(width=0.1)
    c = c * 0.5 ** np.arange(ORDER)
    out = CALLS[name](SPACE, clock(centre, radius), path(c))
    lo, hi = out.range
    nodes = -np.cos(np.pi * np.arange(ORDER) / (ORDER - 1))
    for k in range(3):
        value = lambda s, k=k: CALLS[name](
            np, centre[k] + s * radius[k], np.array([np.polyval(r[::-1], s) for r in c[:, k]])
        )
        scan = np.linspace(-1, 1, 101)
        true = np.array([value(s) for s in scan])
        at_nodes = np.array([value(s) for s in nodes])
        assert np.all(lo[:, k] <= true.min(0) + 1e-14) and np.all(true.max(0) - 1e-14 <= hi[:, k])
        fit = np.polynomial.chebyshev.chebvander(scan, ORDER - 1) @ np.linalg.solve(
            np.polynomial.chebyshev.chebvander(nodes, ORDER - 1), at_nodes
        )
        bound = (np.abs(out.mid) + out.rad)[:, k, ORDER] / 2.0 ** (ORDER - 2)
        assert np.all(np.abs(fit - true).max(0) <= bound + 1e-13)
        assert np.all(bound < 1e-4), "a bound this wide proves nothing"


@pytest.mark.parametrize(
    "kink",
    [
        lambda xp, t, x: abs(x - 0.2),
        lambda xp, t, x: xp.where(x < 0.2, x, 2 * x),
        lambda xp, t, x: xp.maximum(x, 0.2),
        lambda xp, t, x: xp.sign(x - 0.2),
        lambda xp, t, x: xp.sqrt(x - 0.2),
        lambda xp, t, x: 1.0 / (x - 0.2),
        lambda xp, t, x: xp.floor(4.0 * x - 0.8),
    ],
)
def test_kinks_jumps_and_poles_are_left_open_where_they_lie_and_nowhere_else(kink):
    c = np.zeros((1, 3, ORDER))
    c[0, :, 0] = [0.05, 0.25, 0.35]
    c[0, :, 1] = 0.06
    with np.errstate(all="ignore"):
        out = kink(SPACE, clock(np.zeros(3), np.ones(3)), path(c))
    assert not np.isfinite(out.rad[0, 1, ORDER]) and np.isfinite(out.rad[0, 2]).all()


@pytest.mark.parametrize(
    "call",
    [
        lambda xp, t, x: x if x[0] > 0.0 else -x,
        lambda xp, t, x: x * float(t),
        lambda xp, t, x: np.sort(x),
        lambda xp, t, x: x * 1j,
        lambda xp, t, x: np.append(x, 0),
        lambda xp, t, x: np.insert(x, 0, 1),
    ],
)
def test_what_a_jet_cannot_do_is_a_type_error(call):
    _, centre, radius, c = pieces()
    with pytest.raises(TypeError):
        as_jet(call(SPACE, clock(centre, radius), path(c)), 3)


def test_a_bump_between_samples_cannot_hide():
    """A bump of 1e-4 of the piece leaves all samples alone; the bound on interpolation explodes."""
    c = np.zeros((1, 1, ORDER))
    out = SPACE.exp(-(((clock(np.array([0.5]), np.array([0.5])) - 0.3) / 1e-4) ** 2)) + path(c)
    assert not np.abs(out.rad[0, 0, ORDER]) < 1e10
