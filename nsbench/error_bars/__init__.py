"""A-posteriori error bars of runs of gradient systems: bounds and estimates without a reference."""

from nsbench.error_bars.entry import (
    Bars,
    ErrorBars,
    error_bars,
    restored_bars,
    without_error_bars,
)

__all__ = ["Bars", "ErrorBars", "error_bars", "restored_bars", "without_error_bars"]
