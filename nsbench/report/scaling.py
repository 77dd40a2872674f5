"""Cost against size: families of cases that differ in their number of particles, exponents with
intervals."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from nsbench.report import cost as speed
from nsbench.report.data import Data, Runs
from nsbench.report.style import (
    LEADING_METHOD,
    TIMES,
    format_factor,
    format_number,
    format_power,
    format_seconds,
    method_of,
)
from nsbench.report.svg_plots import Line, Panel
from nsbench.report.tables import Cell, Row, Table

TARGET = 1e-3  # the equal error of the exponents: reached by most methods on most scenes
FINEST_RUNS = 5  # runs of the ladder's end whose seconds per step are averaged (median)


@dataclass(frozen=True)
class Power:
    """seconds = C N^exponent; interval at 95 % (NaN for two sizes); sizes (m,), values (m,) in
    seconds."""

    exponent: float
    interval: tuple[float, float]
    sizes: np.ndarray
    values: np.ndarray

    def __str__(self) -> str:
        lo, hi = self.interval
        return f"{self.exponent:z.2f}" + (f" [{lo:z.2f}, {hi:z.2f}]" if math.isfinite(lo) else "")


def fit_power(sizes, values) -> Power | None:
    """Least squares in the logarithms, with the t-based interval of the slope; None for fewer than
    two sizes."""
    x = np.log(np.asarray(sizes, float))
    y = np.log(np.asarray(values, float))
    if len(set(sizes)) < 2:
        return None
    dx = x - x.mean()
    slope = float(dx @ y / (dx @ dx))
    rest = y - y.mean() - slope * dx
    m = len(x)
    half = math.nan
    if m > 2:
        from scipy.special import stdtrit

        half = float(stdtrit(m - 2, 0.975)) * math.sqrt(
            float(rest @ rest) / (m - 2) / float(dx @ dx)
        )
    return Power(
        slope, (slope - half, slope + half), np.asarray(sizes, float), np.asarray(values, float)
    )


def group_by_size(data: Data) -> dict[str, list[str]]:
    """Cases that share their name and all parameters but `n` and those that follow it, by growing
    size of the state.

    A family has at least two sizes.
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
    n = data.cases.get(case, {}).get("n")
    return float(n) if isinstance(n, (int, float)) and n > 0 else 0.0


def seconds_per_step(runs: Runs) -> float:
    """Seconds of one step: the median over the finest runs; NaN where steps are not counted."""
    col = runs.col
    use = np.flatnonzero(runs.good & (col["steps"] > 0) & (col["seconds"] > 0))[-FINEST_RUNS:]
    return float(np.median(col["seconds"][use] / col["steps"][use])) if use.size else math.nan


def fit_powers(data: Data, keys: list[str], solver: str) -> tuple[Power | None, Power | None]:
    """Cost of one step and cost of an error of TARGET against the size of the state."""
    out = []
    for cost in (lambda r: seconds_per_step(r) if r.accuracy == "h" else math.nan, _at_target):
        found = [
            (_size(data, k), cost(data.runs[k, solver])) for k in keys if (k, solver) in data.runs
        ]
        found = [(n, v) for n, v in found if v > 0]
        out.append(fit_power(*zip(*found, strict=True)) if found else None)
    return out[0], out[1]


def _at_target(runs: Runs) -> float:
    c = speed.cost_at_error(runs, TARGET)
    return math.nan if c is None or c.at_most else c.seconds


def scaling_table(data: Data) -> Table:
    """Family x method: exponents of the cost in the size of the state."""
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


def scaling_panels(data: Data, looks: dict) -> list[Panel]:
    """Seconds per step, and to the target, against the size; one pair of panels for each family of
    three sizes or more."""
    out = []
    for name, keys in group_by_size(data).items():
        if len(keys) < 3:
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
    """Families by size: the cheapest compiled method at each error, with factors over the next one
    and over PBD."""
    rows = []
    for name, keys in group_by_size(data).items():
        for case in keys:
            cells = [Cell(case, kind="method")]
            cells += [
                _cheapest([c for c in speed.rank_costs(data, case, t) if c.loop == "compiled"])
                for t in speed.TARGETS
            ]
            rows.append(Row(tuple(cells), name))
    return Table(
        "sizes",
        ("case", *(f"error {format_power(t)}" for t in speed.TARGETS)),
        tuple(rows),
        f"The cheapest compiled method, and by which factor the next one and {LEADING_METHOD} are "
        "dearer. ≤: the coarsest run tried was already better, so that factors are bounds.",
    )


def _cheapest(found: list[speed.Cost]) -> Cell:
    if not found:
        return Cell("not reached", kind="quiet")
    first, *others = found
    others = [c for c in others if not speed.why_not_comparable(c, first)]
    pbd = next((c for c in (first, *others) if method_of(c.solver) == LEADING_METHOD), None)
    told = [f"{'≤ ' if first.at_most else ''}{format_seconds(first.seconds)}"]
    told += (
        [f"next {TIMES} {format_factor(others[0].seconds / first.seconds)} ({others[0].solver})"]
        if others
        else []
    )
    if pbd is None:
        told.append(f"no {LEADING_METHOD}")
    elif pbd is not first and pbd is not (others[0] if others else None):
        told.append(f"{LEADING_METHOD} {TIMES} {format_factor(pbd.seconds / first.seconds)}")
    title = (
        f"quartiles {format_number(first.low)} to {format_number(first.high)} s"
        if math.isfinite(first.low)
        else ""
    )
    return Cell(first.solver, ", ".join(told), title, "best")


def describe_wins(data: Data) -> list[str]:
    """Whether PBD wins, and where: one sentence per error, over all cases."""
    out = []
    for target in speed.TARGETS:
        own = []
        lost = 0
        far = 0
        for case in data.case_keys:
            found = [c for c in speed.rank_costs(data, case, target) if c.loop == "compiled"]
            if not found:
                continue
            if method_of(found[0].solver) == LEADING_METHOD:
                own.append(case)
            elif any(method_of(c.solver) == LEADING_METHOD for c in found):
                lost += 1
            else:
                far += 1
        if own or lost or far:
            out.append(
                f"Error {format_power(target)}: {LEADING_METHOD}, in whatever order, is the "
                f"cheapest compiled method on {len(own)} of {len(own) + lost + far} cases; another "
                f"one is cheaper on {lost}, and on {far} it does not get there or does not apply."
            )
    return out
