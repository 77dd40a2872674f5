"""Figures of the study of multipliers."""

from __future__ import annotations

from nsbench.report.style import format_number
from nsbench.studies.curves import Curve, Panel, draw_panels
from nsbench.studies.finding import EvidenceFigure
from nsbench.studies.multipliers.equal_cost import KEPT, ZERO
from nsbench.studies.multipliers.settling import last_right

WARM_ORDER = "sorted"


def settling_figure(
    columns: list[dict], piles: list[dict], growth: dict[str, dict], costs: list[list[dict]]
) -> EvidenceFigure:
    """Draw steps until columns and piles are right, and errors at equal cost by case."""
    guide = growth["pbd"]["over_square"][-1]
    panels = [
        _growth_panel("column of discs", columns, guide, "discs", "steps until the floor is right"),
        _growth_panel("pile of discs", piles, None, "rows", "steps until reactions are right"),
    ]
    panels += [_cost_panel(group) for group in costs]
    return EvidenceFigure(
        "settling",
        "Steps until the load of a column has reached its floor, and until the reactions of a "
        "pile are right; state error over the number of sweeps when steps are as many times "
        "longer (warm: one more).",
        draw_panels(panels, columns=3),
    )


def _growth_panel(title, found, guide, x_label, y_label) -> Panel:
    """Draw steps over n of each method; guide: of the curve guide n^2, None: none."""
    curves = []
    for method in dict.fromkeys(f["method"] for f in found):
        own = [f for f in found if f["method"] == method]
        curves.append(Curve(method, [f["n"] for f in own], [last_right(f) for f in own]))
    if guide is not None:
        sizes = sorted({f["n"] for f in found})
        name = f"{format_number(guide, 3)} n^2"
        curves.append(Curve(name, sizes, [guide * n**2 for n in sizes], guide=True))
    return Panel(title, tuple(curves), x_label, y_label)


def _cost_panel(group: list[dict]) -> Panel:
    # from kept multipliers the orders are alike: one of them stands for all
    drawn = [(ZERO, order) for order in dict.fromkeys(r["order"] for r in group)]
    curves = []
    for start, order in [*drawn, (KEPT, WARM_ORDER)]:
        own = [r for r in group if r["order"] == order and r["start"] == start]
        name = f"{order}, warm" if start == KEPT else order
        curves.append(Curve(name, [r["sweeps"] for r in own], [r["state"] for r in own]))
    return Panel(
        group[0]["case"], tuple(curves), "sweeps per step, at equal cost", "largest state error"
    )
