"""Errors, residuals and orders of convergence of a trajectory, computed by the bench and not taken
from the word of a solver; clock of interleaved runs."""

from nsbench.measure.errors import errors
from nsbench.measure.orders import VERDICTS, Fit, fit_order
from nsbench.measure.orders.window import rounding

__all__ = ["VERDICTS", "Fit", "errors", "fit_order", "rounding"]
