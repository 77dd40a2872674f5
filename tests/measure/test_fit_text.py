"""What a fit says of itself in text and in HTML: an order, or first that there is none and why."""

import numpy as np
import pytest

from nsbench.measure.orders import fit_order

H = 0.1 * 2.0 ** -np.linspace(0.0, 6.3, 25)  # four steps per octave at irrational ratios
SHORT = H[:4]
NO_ORDER = {
    "too short": (SHORT, SHORT**-1.3, "undecided", "octaves with 4 steps; 6 with 18 are needed"),
    "growing": (H, H**-1.3, "diverges", "the error grows as the step shrinks"),
    "drifting": (H, H + 300 * H**2, "pre-asymptotic", "the local slope still drifts"),
    "so slow": (H, H**0.15, "undecided", "so slow that a logarithm, or no convergence, fits"),
    "dyadic": (2.0 ** -np.arange(12), 2.0 ** -np.arange(12), "undecided", "the steps are dyadic"),
}


@pytest.mark.parametrize("name", NO_ORDER)
def test_a_fit_without_an_order_says_so_before_its_slope(name):
    """In text and in HTML; the number is never called an order."""
    h, err, verdict, why = NO_ORDER[name]
    fit = fit_order(h, err)
    assert fit.verdict == verdict and why in fit.reason, (fit.verdict, fit.reason)
    assert repr(fit).startswith(f"Fit({verdict}: no order ({fit.reason}), slope of the fit ")
    assert str(fit) == repr(fit) and f"slope of the fit {fit.order:.3f} [" in str(fit)
    assert "], not an order, " in str(fit) and ", constant " not in str(fit)
    table = fit._repr_html_()
    assert f"none found; {fit.reason}; slope of the fit {fit.order:.3f} [" in table
    assert "95 % interval" not in table and "<th style='text-align:left'>constant" not in table


@pytest.mark.parametrize(
    ("h", "err", "shown"),
    [
        (H[:2], H[:2], "Fit(undecided: no order (2 usable steps; 3 are needed), 0 points)"),
        (H, 1e-20 * H, "Fit(exact: no order (all errors are rounding), 0 points)"),
        (H, 0 * H + 0.5, "Fit(plateau at 0.5, 25 points)"),
        (H, 3 * H, "Fit(order, order 1.000 [1.000, 1.000], constant 3, 25 points)"),
    ],
)
def test_a_fit_shows_no_number_that_it_lacks(h, err, shown):
    fit = fit_order(h, err)
    assert repr(fit) == shown
    assert "nan" not in fit._repr_html_()
    assert bool(fit.reason) == (fit.verdict != "order")
