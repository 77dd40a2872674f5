"""The power law with a head: least squares against a search, its edge, its interval."""

import itertools

import numpy as np
import pytest

import nsbench
from nsbench.measure.orders import corrected_power_law
from nsbench.measure.orders.corrected_power_law import DECAYED, MODELS, convergent, fit_corrected
from nsbench.measure.orders.window import dyadic

H = 0.1 * 2.0 ** -np.linspace(0.0, 6.3, 25)  # four steps per octave at irrational ratios


@pytest.mark.parametrize("slope, least", [(0.1, 0.5), (0.3, 0.45)])
def test_an_order_that_is_at_least_so_much_fits_as_well_as_a_search_finds(slope, least):
    """Errors whose order is less: the best law has the least order, and a head that bends it."""
    u = np.log(H[::-1])
    u = u - u.max()
    y = slope * u
    found = np.inf
    for q, power in MODELS:
        e = np.exp(q * u)
        top = DECAYED / e[0]
        low = -top if power > 0.0 else -min(top, 0.9)
        shares = np.geomspace(1e-4, 1, 500)
        for r in np.concatenate([low * shares, top * shares]):
            rest = y - least * u - power * np.log(np.maximum(np.abs(1.0 + r * e), 1e-3))
            found = min(found, len(u) * rest.var())
    assert found * (1.0 - 1e-3) <= convergent(u, y, least) <= 1.2 * found
    rounding = len(u) * (8 * np.finfo(float).eps) ** 2
    assert rounding <= convergent(u, least * u, least) < 1e-20


@pytest.mark.parametrize("share, is_edge", [(0.105, False), (0.118, True)])
def test_a_slope_that_is_no_order_yet_is_judged_at_the_finest_step(share, is_edge):
    """h (1 + r h): the local slope is 1 + share / (1 + share), a tenth off from share = 1 / 9."""
    u = np.log(H[::-1])
    u = u - u.max()
    r = share / np.exp(u[0])
    assert fit_corrected(u, u + np.log1p(r * np.exp(u))).edge == is_edge


def test_the_interval_of_a_clean_law_is_as_wide_as_the_reference_is_wrong():
    u = np.log(H[::-1])
    some, more = (fit_corrected(u, u, own).half for own in (1e-4, 1e-3))
    assert more == pytest.approx(10.0 * some, rel=1e-3) and some > 1e-5


@pytest.mark.parametrize("n", [8, 20, 41])
def test_correlated_residuals_widen_the_interval_by_what_they_correlate(n):
    """(1 + r) / (1 - r), r the correlation of neighbours corrected for three parameters."""
    for step in (0.3, 0.6, 1.2, 3.0):
        resid = np.cos(step * np.arange(n))
        rho = sum(a * b for a, b in itertools.pairwise(resid)) / sum(resid**2)
        r = max((rho * n + 2.0) / (n - 4.0), 0.0)
        expected = min((1.0 + r) / (1.0 - r), 9.0) if r < 1.0 else 9.0
        assert corrected_power_law._inflation(resid) == pytest.approx(expected)
    assert corrected_power_law._inflation(np.ones(7)) == 1.0


def test_five_errors_show_no_bend_beyond_the_head():
    u = np.log(H[::-1])[:5]
    found = fit_corrected(u - u.max(), u**2)
    assert (found.bend, found.drift) == (0.0, 0.0)


@pytest.mark.parametrize("bump", [1.1, 2.0])
def test_a_point_that_is_off_leaves_the_window_where_one_shorter_one_is_allowed(bump):
    h = 0.1 * 2.0 ** (-np.arange(10) * 0.4)
    errors = h.copy()
    errors[0] *= bump
    found = nsbench.fit_order(h, errors)
    assert found.order == pytest.approx(1.0) and np.ptp(found.interval) < 1e-9
    assert max(found.window) == h[1]


def wobbling(n, head):
    """Steps (n,) over 3.3 or 6.3 octaves, and errors 2 h (1 + head h) with a scatter of 2 %."""
    h = 0.1 * 2.0 ** -np.linspace(0.0, 6.3 if n > 14 else 3.3, n)
    return h, 2.0 * h * (1.0 + head * (h / h[0])) * np.exp(0.02 * np.sin(7.0 * np.arange(n) ** 2))


@pytest.mark.parametrize(
    "n, head, numbers",
    [
        (9, 0.0, (0.9779112887752, 0.0594104632324, 1.374783359574, 1.056494423816)),
        (14, 0.5, (1.0006615921996, 0.0916089747684, 0.279833591372, -0.289661695402)),
        (25, -0.3, (1.0051912126510, 0.0244209041491, 0.791201830872, -0.031958312360)),
        (25, 3.0, (1.0046838384348, 0.0228381315703, 0.567156796795, 0.044623768417)),
    ],
)
def test_numbers_of_a_fit_stay_as_they_are(n, head, numbers):
    """Order, half its interval, bend and drift, of the code whose coverage test_orders.py measures;
    the fit of the whole ladder keeps them."""
    h, errors = wobbling(n, head)
    fit = fit_corrected(np.log(h[::-1]), np.log(errors[::-1]))
    assert (fit.p, fit.half, fit.bend, fit.drift) == pytest.approx(numbers, rel=1e-6)
    whole = nsbench.fit_order(h, errors)
    assert whole.order == fit.p and whole.interval == (fit.p - fit.half, fit.p + fit.half)
    assert whole.window == (h[-1], h[0]) and whole.points == n


def test_numbers_of_a_shorter_window_stay_as_they_are():
    """A head of high order at the coarse end, which no shape of a head explains: the interval is
    widened by half the drift and by the distance to the order of the next window."""
    h, errors = wobbling(25, 0.0)
    found = nsbench.fit_order(h, errors * (1.0 + 40.0 * (h / h[0]) ** 9))
    assert found.points == 20 and found.verdict == "order"
    assert found.interval == pytest.approx((0.9758011646739, 1.0318280516072), rel=1e-6)


@pytest.mark.parametrize("slope, verdict", [(0.199, "undecided"), (0.201, "order")])
def test_below_a_fifth_an_order_is_as_slow_as_a_logarithm(slope, verdict):
    assert nsbench.fit_order(H, H**slope).verdict == verdict


@pytest.mark.parametrize(
    "slope, count, verdict",
    [
        (-0.099, 12, "undecided"),
        (-0.101, 12, "diverges"),
        (-0.5, 5, "diverges"),
        (-0.5, 4, "undecided"),
    ],
)
def test_growth_is_told_from_a_tenth_and_five_errors_on(slope, count, verdict):
    h = H[:count]
    assert nsbench.fit_order(h, h**slope).verdict == verdict
    scattered = h**slope * np.where(np.arange(count) % 2, 3.0, 1.0)
    assert nsbench.fit_order(h, scattered).verdict == "undecided"


@pytest.mark.parametrize("phases, few", [((0.3,), True), ((0.3, 0.6), False)])
def test_steps_at_fewer_than_three_phases_of_an_octave_are_dyadic(phases, few):
    octaves = np.arange(5.0)
    assert dyadic(2.0 ** -np.concatenate([octaves, *(octaves + p for p in phases)])) == few
    for apart, same in ((0.0199, True), (0.0201, False)):
        assert dyadic(2.0 ** np.array([0.1, 0.5, 0.5 + apart, 1.1])) == same


def turning(turns):
    """Steps, and factors that turn with the phase of the step."""
    h = 0.1 * 2.0 ** -np.linspace(0.0, 6.3, 60)
    return h, 0.02 + np.abs(np.sin(turns * np.log(h)))


@pytest.mark.parametrize("power, is_bent", [(9.0, False), (2.0, True)])
def test_largest_errors_have_an_order_unless_they_bend(power, is_bent):
    """With a head at the coarse end."""
    h, factor = turning(51.0)
    found = nsbench.fit_order(h, h * factor * (1.0 + 3.0 * (h / h[0]) ** power))
    assert found.verdict == ("undecided" if is_bent else "order")
    assert found.sentence.startswith("Order of the largest error") != is_bent
    assert found.window == (h[-1], h[0])


@pytest.mark.parametrize("slope, turns", [(0.15, 47.0), (1.0, 39.0)])
def test_largest_errors_that_fall_slowly_or_by_an_uncertain_order_have_none(slope, turns):
    h, factor = turning(turns)
    assert nsbench.fit_order(h, h**slope * factor).verdict == "undecided"
