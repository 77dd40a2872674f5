"""Compute performance profiles: how often a method is within a factor of the fastest one.

Dolan & More, Benchmarking optimization software with performance profiles, Math. Program. 91
(2002): rho_s(tau) is the share of the cases that method s solves within tau times the time of the
best. Here "solves" means that the state error comes, and stays, below a target, and a time is the
seconds interpolated on the work-precision curve (cost.cost_at_error); where the coarsest run tried
is already better, its seconds count.
"""

from __future__ import annotations

import math

import numpy as np

from nsbench.report import cost
from nsbench.report.data import Data
from nsbench.report.style import INK, MUTED, RULE, Look, format_count, format_power
from nsbench.report.svg_plots import (
    BOTTOM,
    DASHES,
    HEIGHT,
    LEFT,
    RIGHT,
    WIDTH,
    Pen,
    marker_style,
)

MAX_DECADES = 3.0  # of tau that a profile shows
NEAR_FACTOR = 10.0  # within it of the fastest, a method is called near


def time_ratios(data: Data, target: float) -> dict[str, np.ndarray]:
    """Compute the seconds of each method over the best ones: solver -> (cases,), inf: not solved.

    The cases are those that some compiled method solves. Methods whose loop is not compiled, or
    that were not timed with the others, are left out (cost.why_not_comparable).
    """
    seconds_over_best: dict[str, list[float]] = {}
    solved_cases = 0
    for case in data.case_keys:
        found = [c for c in cost.rank_costs(data, case, target) if c.seconds > 0]
        found = [c for c in found if not cost.why_not_comparable(c, found[0])]
        if not found:
            continue
        best = min(c.seconds for c in found)
        for c in found:
            seconds_over_best.setdefault(c.solver, [math.inf] * solved_cases).append(
                c.seconds / best
            )
        solved_cases += 1
        for row in seconds_over_best.values():
            row += [math.inf] * (solved_cases - len(row))
    return {
        solver: np.array(seconds_over_best[solver])
        for solver in data.specs
        if solver in seconds_over_best
    }


def draw_profile(data: Data, target: float, looks: dict[str, Look]) -> str:
    """Draw the profile of one target as an SVG panel; "" where no case is solved."""
    found = time_ratios(data, target)
    if not found:
        return ""
    cases = len(next(iter(found.values())))
    pen = Pen((0.0, MAX_DECADES), (0.0, 1.0))
    grid = [((k, 0.0), (k, 1.0)) for k in range(int(MAX_DECADES) + 1)] + [
        ((0.0, y), (MAX_DECADES, y)) for y in (0.25, 0.5, 0.75, 1.0)
    ]
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}">',
        pen.segments(grid, stroke=RULE, stroke_width=0.5),
        pen.path([(0.0, 1.0), (0.0, 0.0), (MAX_DECADES, 0.0)], stroke=MUTED, stroke_width=0.7),
    ]
    for solver, values in found.items():
        parts.append(_curve(pen, np.sort(np.log10(values)), cases, looks[solver]))
    parts += [
        pen.text(k, 0.0, f"{10**k}", 7, anchor="middle", down=9)
        for k in range(int(MAX_DECADES) + 1)
    ]
    parts += [
        f'<text x="{LEFT - 3}" y="{pen.y(y) + 2.5:.1f}" font-size="7" fill="{MUTED}" '
        f'text-anchor="end">{y:g}</text>'
        for y in (0.0, 0.5, 1.0)
    ]
    parts += [
        f'<text x="{(LEFT + RIGHT) / 2}" y="{BOTTOM + 21}" font-size="7.5" fill="{MUTED}" '
        f'text-anchor="middle">'
        "seconds over those of the fastest method</text>",
        pen.text(
            0.0,
            1.0,
            f"Error {format_power(target)}: share of {format_count(cases, 'case')}",
            8.5,
            INK,
            down=-6,
        ),
        "</svg>",
    ]
    return "\n".join(parts)


def _curve(pen: Pen, log_ratios: np.ndarray, cases: int, look: Look) -> str:
    """A staircase that rises by 1/cases at each ratio, with the marker of the method at its end."""
    points = []
    share = 0.0
    for k, decade in enumerate(log_ratios[log_ratios <= MAX_DECADES]):
        points += [(decade, share), (decade, (k + 1) / cases)]
        share = (k + 1) / cases
    points += [(MAX_DECADES, share)]
    return (
        f'<g id="s{look.index}">'
        + pen.path(points, stroke=look.colour, stroke_width=1.2, stroke_dasharray=DASHES[look.line])
        + pen.path([points[-1]], style=marker_style("m", look.index))
        + "</g>"
    )


def describe_profiles(data: Data) -> list[str]:
    """Write a sentence per target: the methods fastest most often, and the one near most often.

    Of one case, nothing.
    """
    out: list[str] = []
    for target in cost.TARGETS if len(data.case_keys) > 1 else ():
        found = time_ratios(data, target)
        if not found:
            continue
        cases = len(next(iter(found.values())))
        first = sorted(found, key=lambda s: (-np.sum(found[s] <= 1.0), s))[:3]
        fastest = ", ".join(
            f"{s} on {int(np.sum(found[s] <= 1.0))}" for s in first if np.any(found[s] <= 1.0)
        )
        near = max(found, key=lambda s: (np.sum(found[s] <= NEAR_FACTOR), s))
        out.append(
            f"Error {format_power(target)}, compiled loops alone: fastest is {fastest} of "
            f"{format_count(cases, 'case')}; most often within a factor of ten is {near} "
            f"({int(np.sum(found[near] <= NEAR_FACTOR))})."
        )
    return out
