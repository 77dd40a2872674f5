"""Compute how the cost grows with the size of a scene: exponents of power laws with intervals.

Cases that differ in their number of particles form a family. For each method, seconds = C N^p in
the size N of the state is fitted by least squares in the logarithms.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nsbench.report.cost import (
    TARGETS,
    Cost,
    cost_at_error,
    rank_costs,
    why_not_comparable,
)
from nsbench.report.data import Data, Runs
from nsbench.report.style import (
    LEADING_METHOD,
    TIMES,
    Look,
    format_factor,
    format_number,
    format_power,
    format_seconds,
    method_of,
)
from nsbench.report.svg_plots import Line, Panel
from nsbench.report.tables.cells import Cell, Row, Table

TARGET = 1e-3  # the equal error of the exponents: reached by most methods on most scenes
FINEST_RUNS = 5  # at the end of the step ladder: the median of their seconds per step is used
MIN_SIZES = 3  # of a family with panels: two points always lie on a line
CONFIDENCE_QUANTILE = 0.975  # of Student's t: 95 % on two sides


@dataclass(frozen=True)
class Power:
    """A power law seconds = C N^exponent.

    interval: of the exponent, at 95 %; NaN for two sizes. sizes (m,): of the state; values (m,):
    seconds.
    """

    exponent: float
    interval: tuple[float, float]
    sizes: np.ndarray
    values: np.ndarray

    def __str__(self) -> str:
        lo, hi = self.interval
        return f"{self.exponent:z.2f}" + (f" [{lo:z.2f}, {hi:z.2f}]" if math.isfinite(lo) else "")


def fit_power(sizes: Sequence[float], values: Sequence[float]) -> Power | None:
    """Fit a power law by least squares in the logarithms; None for fewer than two sizes.

    The interval is that of Student's t for the slope.
    """
    x = np.log(np.asarray(sizes, float))
    y = np.log(np.asarray(values, float))
    if len(set(sizes)) < 2:
        return None
    dx = x - x.mean()
    slope = float(dx @ y / (dx @ dx))
    residual = y - y.mean() - slope * dx
    m = len(x)
    half_width = math.nan
    if m > 2:
        from scipy.special import stdtrit

        half_width = float(stdtrit(m - 2, CONFIDENCE_QUANTILE)) * math.sqrt(
            float(residual @ residual) / (m - 2) / float(dx @ dx)
        )
    return Power(
        slope,
        (slope - half_width, slope + half_width),
        np.asarray(sizes, float),
        np.asarray(values, float),
    )


def group_by_size(data: Data) -> dict[str, list[str]]:
    """Group cases that share their name and all parameters but `n` and those that follow it.

    Returns name -> cases by growing size of the state; a family has at least two sizes.
    """
    groups: dict[str, list[str]] = {}
    for case in data.case_keys:
        if _size(data, case) > 0:
            name, _, inside = case.partition("[")
            rest = [
                p for p in inside.rstrip("]").split(",") if p and not p.startswith(("n=", "box="))
            ]
            groups.setdefault(f"{name}[{','.join(rest)}]" if rest else name, []).append(case)
    out = {name: sorted(keys, key=lambda k: _size(data, k)) for name, keys in groups.items()}
    return {name: keys for name, keys in out.items() if len({_size(data, k) for k in keys}) > 1}


def _size(data: Data, case: str) -> float:
    """Size of the state of a case; 0 if it is not stored."""
    n = data.cases.get(case, {}).get("n")
    return float(n) if isinstance(n, (int, float)) and n > 0 else 0.0


def seconds_per_step(runs: Runs) -> float:
    """Compute the seconds of one step, a median over the finest runs; NaN without counted steps."""
    col = runs.col
    use = np.flatnonzero(runs.good & (col["steps"] > 0) & (col["seconds"] > 0))[-FINEST_RUNS:]
    return float(np.median(col["seconds"][use] / col["steps"][use])) if use.size else math.nan


def fit_powers(data: Data, keys: list[str], solver: str) -> tuple[Power | None, Power | None]:
    """Fit the cost of one step, and that of an error of TARGET, against the size of the state."""
    out = []
    for cost in (lambda r: seconds_per_step(r) if r.accuracy == "h" else math.nan, _at_target):
        found = [
            (_size(data, k), cost(data.runs[k, solver])) for k in keys if (k, solver) in data.runs
        ]
        found = [(n, v) for n, v in found if v > 0]
        out.append(fit_power(*zip(*found, strict=True)) if found else None)
    return out[0], out[1]


def _at_target(runs: Runs) -> float:
    c = cost_at_error(runs, TARGET)
    return math.nan if c is None or c.at_most else c.seconds


def scaling_table(data: Data) -> Table:
    """Build the table of exponents: family x method."""
    rows = []
    for name, keys in group_by_size(data).items():
        sizes = ", ".join(f"{_size(data, k):.0f}" for k in keys)
        for solver in dict.fromkeys(s for k, s in data.runs if k in keys):
            step, error = fit_powers(data, keys, solver)
            if step is None and error is None:
                continue
            rows.append(
                Row(
                    (Cell(solver, kind="method"), Cell(sizes), _power(step), _power(error)),
                    name,
                    solver,
                )
            )
    return Table(
        "scaling",
        ("method", "sizes of the state", "one step", f"to an error of {format_power(TARGET)}"),
        tuple(rows),
        "Exponent p of seconds = C N^p in the size N of the state, with its 95 % interval where "
        "there are three sizes or more; below, the seconds at the largest. An error is that of "
        "the whole state at the largest sample, and larger scenes are harder, not only larger.",
    )


def _power(p: Power | None) -> Cell:
    return (
        Cell("none", kind="quiet")
        if p is None
        else Cell(str(p), format_seconds(float(p.values[-1])), kind="number")
    )


def scaling_panels(data: Data, looks: dict[str, Look]) -> list[Panel]:
    """Build panels of seconds per step, and to the target, against the size.

    There is one pair of panels for each family of MIN_SIZES sizes or more.
    """
    out = []
    for name, keys in group_by_size(data).items():
        if len(keys) < MIN_SIZES:
            continue
        lines: tuple[list, list] = ([], [])
        for solver in dict.fromkeys(s for k, s in data.runs if k in keys):
            hollow = any(
                data.runs[k, solver].loop == "host" for k in keys if (k, solver) in data.runs
            )
            for place, p in zip(lines, fit_powers(data, keys, solver), strict=True):
                if p is not None:
                    place.append(
                        Line(solver, looks[solver], p.sizes, p.values, np.empty(0), hollow=hollow)
                    )
        for key, title, found in (
            ("step", "seconds per step", lines[0]),
            ("error", f"seconds to {format_power(TARGET)}", lines[1]),
        ):
            if found:
                out.append(Panel(key, f"{name}: {title}", "size of the state", tuple(found)))
    return out


def sizes_table(data: Data) -> Table:
    """Build the table of the cheapest compiled method by size and error.

    It gives the factors over the next cheapest one and over PBD.
    """
    rows = []
    for name, keys in group_by_size(data).items():
        for case in keys:
            cells = [Cell(case, kind="method")]
            cells += [
                _cheapest([c for c in rank_costs(data, case, t) if c.loop == "compiled"])
                for t in TARGETS
            ]
            rows.append(Row(tuple(cells), name))
    return Table(
        "sizes",
        ("case", *(f"error {format_power(t)}" for t in TARGETS)),
        tuple(rows),
        f"The cheapest compiled method, and by which factor the next one and {LEADING_METHOD} are "
        "dearer. ≤: the coarsest run tried was already better, so that factors are bounds.",
    )


def _cheapest(found: list[Cost]) -> Cell:
    if not found:
        return Cell("not reached", kind="quiet")
    first, *others = found
    others = [c for c in others if not why_not_comparable(c, first)]
    pbd = next((c for c in (first, *others) if method_of(c.solver) == LEADING_METHOD), None)
    parts = [f"{'≤ ' if first.at_most else ''}{format_seconds(first.seconds)}"]
    parts += (
        [f"next {TIMES} {format_factor(others[0].seconds / first.seconds)} ({others[0].solver})"]
        if others
        else []
    )
    if pbd is None:
        parts.append(f"no {LEADING_METHOD}")
    elif pbd is not first and pbd is not (others[0] if others else None):
        parts.append(f"{LEADING_METHOD} {TIMES} {format_factor(pbd.seconds / first.seconds)}")
    title = (
        f"quartiles {format_number(first.low)} to {format_number(first.high)} s"
        if math.isfinite(first.low)
        else ""
    )
    return Cell(first.solver, ", ".join(parts), title, "best")


def describe_wins(data: Data) -> list[str]:
    """Count for each error the cases on which PBD is the cheapest compiled method, or is not.

    Of a study without it, or of one case, nothing.
    """
    out: list[str] = []
    with_pbd = any(method_of(solver) == LEADING_METHOD for solver in data.specs)
    if len(data.case_keys) < 2 or not with_pbd:
        return out
    for target in TARGETS:
        won = []
        dearer = 0
        not_reached = 0
        for case in data.case_keys:
            found = [c for c in rank_costs(data, case, target) if c.loop == "compiled"]
            if not found:
                continue
            if method_of(found[0].solver) == LEADING_METHOD:
                won.append(case)
            elif any(method_of(c.solver) == LEADING_METHOD for c in found):
                dearer += 1
            else:
                not_reached += 1
        cases = len(won) + dearer + not_reached
        if cases:
            out.append(
                f"Error {format_power(target)}: {LEADING_METHOD}, in whatever order, is the "
                f"cheapest compiled method on {len(won)} of {cases} cases; another one is cheaper "
                f"on {dearer}, and on {not_reached} it does not get there or does not apply."
            )
    return out
