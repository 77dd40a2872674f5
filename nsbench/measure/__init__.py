"""Errors, residuals and orders of convergence of a trajectory, and the clock of interleaved runs.

The bench computes them itself, from samples and impulses, and takes none from the report of a
method.
"""

from nsbench.measure.compared_multiplier import why_reaction
from nsbench.measure.errors import errors
from nsbench.measure.orders import VERDICTS, Fit, fit_order
from nsbench.measure.orders.window import left_open, rounding

__all__ = ["VERDICTS", "Fit", "errors", "fit_order", "left_open", "rounding", "why_reaction"]
