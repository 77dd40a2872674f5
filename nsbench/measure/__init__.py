"""Errors, residuals and orders of what a solver returned, computed by the bench and not taken from
its word."""

from nsbench.measure.errors import errors
from nsbench.measure.orders import VERDICTS, Fit, fit_order
from nsbench.measure.orders.window import rounding

__all__ = ["VERDICTS", "Fit", "errors", "fit_order", "rounding"]
