"""Page of a comparison: changes and their confidence intervals, scatters old over new, history.

It has the form of the page of a study: question, answer, evidence, tables, figures, command.
"""

from __future__ import annotations

import math
from collections import defaultdict

from nsbench.gate.compared_numbers import Version, common_seconds
from nsbench.gate.comparison import BAD, Difference, count_outcomes
from nsbench.report.charts.files import draw_svg, with_data
from nsbench.report.charts.layouts import history_chart, scatter_chart
from nsbench.report.study_pages import StudyFigure, StudySection
from nsbench.report.style import assign_looks, format_factor, format_number
from nsbench.report.tables.cells import Cell, Row, Table

MAX_CHANGES = 500  # of the table; the others are counted
DIGITS = 4
PER_DECADE = 50  # places of a logarithmic axis at which points are told apart
# groups of the scatter by the last word of a metric; all others are errors and residuals
GROUPS = {"order": "orders", "constant": "constants", "plateau": "constants"}
WORK = "counted work"
ERRORS = "errors and residuals"


def comparison_section(versions: list[Version], differences: list[Difference]) -> StudySection:
    """Lay out the comparison of the last version with the one before, and the history of all.

    differences: of the last version against the one before (nsbench.gate.comparison).
    """
    old, new = versions[-2:]
    names = " ".join(v.name for v in versions)
    same = all(f.outcome not in BAD for f in differences)
    answer = f"{'Nothing changed' if same else 'Something changed'}: {count_outcomes(differences)}."
    seconds = common_seconds(versions)
    tables = [("What changed", _changes(old, new, differences))]
    figures = _scatters(old, new, seconds)
    if len(versions) > 2:
        tables += _histories(versions, seconds)
        figures += _history_figures(versions, seconds)
    return StudySection(
        name="comparison",
        question=f"What changed from {old.name} to {new.name}?",
        short="",
        answer=answer,
        evidence=tuple(_evidence(old, new, differences, seconds)),
        refutation="the same command on results that were computed anew.",
        command=f"nsbench compare {names}",
        note="Seconds of different machines or hours are no finding.",
        tables=tuple(tables),
        figures=tuple(figures),
    )


def _evidence(old, new, differences, seconds):
    """Yield sentences: orders beyond their intervals, the seconds, what is missing or new."""
    orders = [f.key for f in differences if old.half_width(f.key) >= 0.0 and f.outcome in BAD]
    beyond = [k for k in orders if not _within(old, new, k)]
    yield (
        f"{len(beyond)} of {len(orders)} orders that changed lie outside the 95 % interval of "
        "before."
        if orders
        else "No order changed."
    )
    ratios = sorted(s[-1] / s[-2] for s in seconds.values() if s[-2] > 0.0)
    if ratios:
        low, middle, high = (ratios[int(q * (len(ratios) - 1))] for q in (0.25, 0.5, 0.75))
        yield (
            f"Seconds after over before, {len(ratios)} runs at a shared accuracy: median "
            f"{format_factor(middle)}, quartiles {format_factor(low)} and {format_factor(high)}."
        )
    sessions = {_machine(v) for v in (old, new)}
    if len(sessions) > 1:
        yield "The two were computed on different machines: their seconds cannot be compared."


def _machine(version: Version) -> str:
    env = version.data.env
    return str(env.get("machine", env.get("cpu", "")))


def _within(old: Version, new: Version, key) -> bool:
    return abs(new.number(key) - old.number(key)) <= old.half_width(key)


def _changes(old: Version, new: Version, differences: list[Difference]) -> Table:
    """Tabulate what is not as before, outcome by outcome, with the interval of before."""
    bad = [f for outcome in BAD for f in differences if f.outcome == outcome]
    rows = [
        Row((Cell(f.outcome), *map(Cell, f.key[1:]), *_values(old, new, f)), group=f.key[0])
        for f in sorted(bad[:MAX_CHANGES], key=lambda f: f.key[0])
    ]
    note = f"{len(bad) - MAX_CHANGES} more are not shown." if len(bad) > MAX_CHANGES else ""
    columns = ("", "method", "at", "number", "before", "after", "change", "interval of before")
    return Table("comparison-changes", columns, tuple(rows), note)


def _values(old: Version, new: Version, difference: Difference) -> tuple[Cell, ...]:
    """Return the cells of a change: before, after, relative change, the interval."""
    key = difference.key
    before, after = (v.facts.get(key) for v in (old, new))
    a = old.number(key)
    b = new.number(key)
    half = old.half_width(key)
    change = f"{100.0 * (b / a - 1.0):+.2g} %" if a and math.isfinite(a * b) else ""
    if not half >= 0.0:
        interval = Cell("–", kind="quiet")
    else:
        inside = "inside" if _within(old, new, key) else "outside"
        interval = Cell(f"± {format_number(half, 2)}, {inside}", kind="number")
    said = [_said(fact) for fact in (before, after)]
    return (*said, Cell(change, kind="number"), interval)


def _said(fact) -> Cell:
    if fact is None:
        return Cell("–", kind="quiet")
    if isinstance(fact.value, str):
        return Cell(fact.value)
    return Cell(format_number(float(fact.value), DIGITS), kind="number")


def _scatters(old: Version, new: Version, seconds) -> list[StudyFigure]:
    """Draw all positive numbers, and the seconds, of the new version over the old one."""
    numbers = [
        _point(f"{key[0]}, {key[1]}, {key[3]}", _group(fact), old.number(key), new.number(key))
        for key, fact in old.facts.items()
    ]
    times = [_point(", ".join(key), "seconds", s[-2], s[-1]) for key, s in seconds.items()]
    out = []
    for name, points, what in (
        ("numbers", numbers, "Every positive number of both versions"),
        ("seconds", times, "Seconds of the same runs"),
    ):
        points = _thinned([p for p in points if p["x"] > 0.0 and 0.0 < p["y"] < math.inf])
        if points:
            ends = [f([p[c] for p in points for c in "xy"]) for f in (min, max)]
            points += [{"kind": "equal", "x": v, "y": v} for v in ends]
            spec = with_data(scatter_chart(old.name, new.name), points)
            caption = f"{what}; on the line they are equal."
            out.append(StudyFigure(caption, draw_svg(_on_any_page(spec)), f"{name}.svg"))
    return out


def _thinned(points: list[dict]) -> list[dict]:
    """Keep one of the points that are drawn on top of one another: the first."""
    place = lambda p: (p["group"], *(round(PER_DECADE * math.log10(p[c])) for c in "xy"))
    return list({place(p): p for p in reversed(points)}.values())[::-1]


def _point(case: str, group: str, x: float, y: float) -> dict:
    return {"kind": "case", "case": case, "group": group, "x": x, "y": y}


def _group(fact) -> str:
    return WORK if fact.kind == "count" else GROUPS.get(fact.metric.split()[-1], ERRORS)


def _on_any_page(spec: dict) -> dict:
    """Let a chart be read on a light page and on a dark one."""
    grey = "#808080"
    axis = dict.fromkeys(("labelColor", "titleColor", "domainColor", "tickColor"), grey)
    axis |= {"gridColor": grey, "gridOpacity": 0.3, "titleFontWeight": "normal"}
    config = {"view": {"stroke": None}, "axis": axis, "legend": {"labelColor": grey}}
    return {**spec, "background": None, "config": config}


def _ratios(versions: list[Version], seconds) -> dict[str, dict[str, list[float]]]:
    """Return by quantity and method the geometric mean of every version over the first one.

    Constants of the state, and seconds, of the cases on which all versions have them.
    """
    logs: dict[str, dict[str, list]] = {
        "constant of the state error": defaultdict(list),
        "seconds": defaultdict(list),
    }
    for key in versions[0].facts:
        values = [v.number(key) for v in versions]
        if key[3] == "state constant" and all(0.0 < v < math.inf for v in values):
            logs["constant of the state error"][key[1]].append(_logs(values))
    for (_, solver), values in seconds.items():
        if all(v > 0.0 for v in values):
            logs["seconds"][solver].append(_logs(values))
    return {
        what: {
            solver: [math.exp(sum(column) / len(rows)) for column in zip(*rows, strict=True)]
            for solver, rows in by_solver.items()
        }
        for what, by_solver in logs.items()
    }


def _logs(values):
    return [math.log(v / values[0]) for v in values]


def _histories(versions, seconds) -> list[tuple[str, Table]]:
    """Tabulate, by method, the mean of every version over the first one."""
    out = []
    columns = ("method", *(v.name for v in versions))
    for what, by_solver in _ratios(versions, seconds).items():
        rows = [
            Row((Cell(s), *(Cell(format_factor(v), kind="number") for v in values)))
            for s, values in sorted(by_solver.items())
        ]
        key = f"comparison-history-{what.split()[0]}"
        note = "Geometric means over the cases that all versions have."
        out.append((f"History: {what}, over the first version", Table(key, columns, rows, note)))
    return out


def _history_figures(versions, seconds) -> list[StudyFigure]:
    """Draw the same as lines over the versions."""
    names = [v.name for v in versions]
    solvers = sorted({s for v in versions for s in v.data.specs})
    looks = list(assign_looks(solvers).items())
    out = []
    for what, by_solver in _ratios(versions, seconds).items():
        points = [
            {"method": s, "version": name, "at": k, "y": value}
            for s, values in by_solver.items()
            for k, (name, value) in enumerate(zip(names, values, strict=True))
        ]
        if points:
            used = [(s, look) for s, look in looks if s in by_solver]
            title = f"{what}, over {names[0]}"
            spec = with_data(history_chart(used, names, title), points)
            file = f"history-{what.split()[0]}.svg"
            out.append(StudyFigure(f"History: {title}.", draw_svg(_on_any_page(spec)), file))
    return out
