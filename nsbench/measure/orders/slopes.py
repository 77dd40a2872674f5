"""Least-squares slopes of log error over log h, and the record of all results of an order fit.

Of all points, of the medians per octave and of the largest errors per octave, each by least squares
with the t-based 95 % interval. They are reported beside the order, whatever its verdict.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from nsbench.html_summary import summary_table
from nsbench.measure.orders.plateau import power_law
from nsbench.measure.orders.window import binned

VERDICTS = (
    "order",
    "exact: no order",
    "plateau",
    "pre-asymptotic",
    "undecided",
    "diverges",
    "below reference",
)
NAN2 = (np.nan, np.nan)


@dataclass(frozen=True, repr=False)
class Fit:
    """Outcome of `fit_order`.

    order      slope of log err over log h that the window tends to (negative: diverges; NaN: none)
    interval   its 95 % interval
    constant   M of err = M h^order
    verdict    one of VERDICTS
    window     (smallest, largest) step used; points: how many
    median     plain slope of the medians per octave, with median_interval
    envelope   plain slope of the largest errors per octave, with envelope_interval
    line       plain slope of all points of the window
    head       share of the further power at the coarsest step of the window
    plateau    C of C + M h^p where one is claimed
    dropped    points left out, by reason
    octaves    length of the whole ladder
    sentence   all this for a reader
    reason     why no order was found, in words; "" where the verdict is "order"

    Without the verdict "order", `order` is the slope of a fit and answers nothing.
    """

    order: float = np.nan
    interval: tuple[float, float] = NAN2
    constant: float = np.nan
    verdict: str = "undecided"
    window: tuple[float, float] = NAN2
    points: int = 0
    median: float = np.nan
    envelope: float = np.nan
    plateau: float = np.nan
    octaves: float = 0.0
    dropped: dict | None = None
    sentence: str = ""
    median_interval: tuple[float, float] = NAN2
    envelope_interval: tuple[float, float] = NAN2
    line: float = np.nan
    head: float = np.nan
    reason: str = ""

    def __repr__(self) -> str:
        """Return verdict, order, interval and constant in a line; the rest are attributes.

        Of no order, the reason comes first and the slope of the fit after it.
        """
        low, high = self.interval
        if self.verdict == "order":
            return (
                f"Fit(order, order {self.order:.3f} [{low:.3f}, {high:.3f}], constant "
                f"{self.constant:.3g}, {self.points} points)"
            )
        if np.isfinite(self.plateau):
            return f"Fit({self.verdict} at {self.plateau:.3g}, {self.points} points)"
        parts = (self._no_order(), self._slope(), f"{self.points} points")
        return f"Fit({', '.join(filter(None, parts))})"

    def _no_order(self) -> str:
        """Say that no order was found, with the verdict and why."""
        said = self.verdict if self.verdict.endswith("no order") else f"{self.verdict}: no order"
        return f"{said} ({self.reason})" if self.reason else said

    def _slope(self) -> str:
        """Return the slope of a fit that shows no order, as no more than that; "" without one."""
        if not np.isfinite(self.line):
            return ""
        low, high = self.interval
        return f"slope of the fit {self.order:.3f} [{low:.3f}, {high:.3f}], not an order"

    def _repr_html_(self) -> str:
        """Return verdict, order or why there is none, window and sentence as a table."""
        lines = [("verdict", self.verdict)]
        if self.verdict == "order":
            lines += [
                ("order", f"{self.order:.3f}"),
                ("95 % interval", f"{self.interval[0]:.3f} to {self.interval[1]:.3f}"),
                ("constant", f"{self.constant:.3g}"),
            ]
        else:
            parts = (self.reason, "" if np.isfinite(self.plateau) else self._slope())
            lines.append(("order", "; ".join(filter(None, ("none found", *parts)))))
        if np.isfinite(self.window[0]):
            window = f"{self.window[0]:.3g} to {self.window[1]:.3g}, {self.points} points"
            lines.append(("window", window))
        lines.append(("in words", self.sentence))
        return summary_table("Order of convergence", lines)


def fit_slope(h: np.ndarray, err: np.ndarray) -> tuple[float, tuple[float, float], float]:
    """Fit a line to log err over log h, h, err (k,).

    Returns slope, its t-based 95 % interval, and the constant exp(intercept); NaN from fewer than
    three points.
    """
    from scipy.special import stdtrit

    n = len(h)
    if n < 3:
        return np.nan, NAN2, np.nan
    u = np.log(h)
    a, p, rss = power_law(u, np.log(err))
    half = float(stdtrit(n - 2, 0.975)) * np.sqrt(rss / (n - 2) / np.sum((u - u.mean()) ** 2))
    return p, (float(p - half), float(p + half)), float(np.exp(a))


def fit_line(h: np.ndarray, err: np.ndarray, fit: Fit) -> Fit:
    """Put the plain slopes into `fit`: of all points, of medians and of largest errors per octave.

    It stands where nothing better can be said.
    """
    p, interval, constant = fit_slope(h, err)
    median = fit_slope(*binned(h, err, np.median))
    envelope = fit_slope(*binned(h, err, np.max))
    return replace(
        fit,
        order=p,
        line=p,
        interval=interval,
        constant=constant,
        points=len(h),
        window=(float(h[0]), float(h[-1])) if len(h) else NAN2,
        median=median[0],
        median_interval=median[1],
        envelope=envelope[0],
        envelope_interval=envelope[1],
    )


def describe_slopes(fit: Fit) -> str:
    """Say the plain slopes per octave, and the points left out, in sentences."""
    slopes = [
        f"{name} {p:.2f} [{lo:.2f}, {hi:.2f}]"
        for name, p, (lo, hi) in (
            ("medians", fit.median, fit.median_interval),
            ("largest errors", fit.envelope, fit.envelope_interval),
        )
        if np.isfinite([p, lo, hi]).all()
    ]
    names = {
        "floor": "below the floor",
        "apart": "far off the others",
        "head": "at the coarse end",
        "not finite": "not finite",
    }
    out = [f"{fit.dropped[k]} {name}" for k, name in names.items() if fit.dropped[k]]
    return (f" Plain slopes per octave: {', '.join(slopes)}." if slopes else "") + (
        f" Left out: {', '.join(out)}." if out else ""
    )
