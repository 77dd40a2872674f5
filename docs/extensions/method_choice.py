"""Directive `method-choice`: which method is cheapest at which error, from the rows of one run.

The rows are those of reports/sample/runs.csv; the README beside them holds the day of the run.
"""

import re
import statistics
from collections import Counter
from pathlib import Path

from docutils import nodes
from sphinx.util.docutils import SphinxDirective

from nsbench.report.answers.best_method import cheapest
from nsbench.report.cost import (
    TARGETS,
    format_setting,
    rank_costs,
    ratio_of_seconds,
    select_baseline,
)
from nsbench.report.data import read

SAMPLE = Path(__file__).parents[2] / "reports" / "sample"
CLASSES = ("Complementarity", "Filippov", "LCS")


def day_of_run():
    """Return the day on which the rows were made, as the README beside them says."""
    return re.search(r"\d{4}-\d{2}-\d{2}", (SAMPLE / "README.md").read_text(encoding="utf-8"))[0]


def problem_classes(data):
    """Return the problem class of each case of the rows that is still registered."""
    from nsbench.case import get_case

    out = {}
    for key in data.case_keys:
        try:
            out[key] = type(get_case(key).problem).__name__
        except (LookupError, ValueError):
            continue
    return out


def cheapest_by_class(data):
    """Lines (class, error, cases that reach it, methods by number of cases) of the first table."""
    classes = problem_classes(data)
    for kind in CLASSES:
        for target in TARGETS:
            best = [rank_costs(data, c, target) for c, k in classes.items() if k == kind]
            wins = Counter(cheapest(found).solver for found in best if found)
            words = ", ".join(f"{name} ({n})" for name, n in wins.most_common(4))
            yield kind, f"{target:g}", f"{sum(wins.values())} of {len(best)}", words or "none"


def factors_over_pbd(data):
    """Lines (method, error, cases, median factor) of the second table."""
    found = {}
    for case in data.case_keys:
        for target in TARGETS:
            costs = rank_costs(data, case, target)
            base = select_baseline(costs)
            for cost in costs if base else ():
                ratio = ratio_of_seconds(cost, base)
                if ratio is not None and cost.solver != base.solver:
                    found.setdefault((cost.solver, target), []).append(ratio)
    for (solver, target), ratios in sorted(found.items()):
        middle = statistics.median(ratios)
        span = f"{min(ratios):.2g} to {max(ratios):.2g}"
        yield solver, f"{target:g}", str(len(ratios)), f"{middle:.2g}", span


def cheapest_by_case(data, target):
    """Lines (case, class, method, setting) of the third table."""
    for case, kind in problem_classes(data).items():
        best = rank_costs(data, case, target)
        if best:
            first = cheapest(best)
            yield case, kind, first.solver, format_setting(first)
        else:
            yield case, kind, "none reaches it", ""


class MethodChoice(SphinxDirective):
    """Insert the tables."""

    def run(self):
        """Return a sentence with the day, and three tables with their titles."""
        self.env.note_dependency(str(SAMPLE / "runs.csv"))
        data = read(SAMPLE)
        rows = sum(len(r) for r in data.runs.values())
        intro = f"Computed from {rows} rows of the run of {day_of_run()} (reports/sample/runs.csv)."
        return [
            nodes.paragraph(text=intro),
            table(
                "Cheapest method at an error of the state, by problem class (number of cases)",
                ("class", "error", "cases that reach it", "cheapest"),
                cheapest_by_class(data),
            ),
            table(
                "Seconds over those of PBD at equal error, where they may be compared",
                ("method", "error", "cases", "median", "from, to"),
                factors_over_pbd(data),
            ),
            table(
                "Cheapest at an error of 1e-3, case by case",
                ("case", "class", "method", "setting"),
                cheapest_by_case(data, 1e-3),
            ),
        ]


def table(title, head, lines):
    """Build a table node of texts."""
    group = nodes.tgroup(cols=len(head))
    for _ in head:
        group += nodes.colspec(colwidth=1)
    group += nodes.thead("", row(head))
    group += nodes.tbody("", *(row(line) for line in lines))
    return nodes.table("", nodes.title(text=title), group)


def row(cells):
    """Build a row of texts."""
    entries = (nodes.entry("", nodes.paragraph(text=c)) for c in cells)
    return nodes.row("", *entries)


def setup(app):
    """Register the directive."""
    app.add_directive("method-choice", MethodChoice)
    return {"parallel_read_safe": True}
