"""Orders of convergence: fits of err ~ M h^p with intervals, windows and verdicts."""

from nsbench.measure.orders.fit import fit_order
from nsbench.measure.orders.slopes import VERDICTS, Fit

__all__ = ["VERDICTS", "Fit", "fit_order"]
