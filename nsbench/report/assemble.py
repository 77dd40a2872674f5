"""Assemble the content of a report from its data: draw figures, compute tables and sentences."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from nsbench.measure.compared_multiplier import NOT_UNIQUE
from nsbench.report import cost, performance_profiles, scaling
from nsbench.report.answers.choices import write_headline
from nsbench.report.answers.multipliers import explain_reactions
from nsbench.report.content import Content
from nsbench.report.data import Data, Runs
from nsbench.report.euler_sliding_figure import (
    describe_euler_sliding_figure,
    draw_euler_sliding_figure,
)
from nsbench.report.expectations import judge_expectations
from nsbench.report.panel_choice import case_panels, cost_panels
from nsbench.report.study_pages import StudySection, cite_studies
from nsbench.report.style import (
    LEADING_METHOD,
    assign_looks,
    file_stem,
    format_number,
    format_power,
    format_seconds,
    method_of,
    sanitise,
)
from nsbench.report.summary import Summary, summarise, without_refusals
from nsbench.report.svg_plots import compose_sheet, draw_panel, inline_svg
from nsbench.report.tables.citation_table import citation_table
from nsbench.report.tables.clock_table import clock_table
from nsbench.report.tables.environment_tables import (
    citation,
    counts_line,
    environment_table,
    glossary_table,
    repeat_lines,
    version_of,
)
from nsbench.report.tables.coarsest_table import coarsest_table
from nsbench.report.tables.equal_error_tables import (
    choice_table,
    ranking_table,
    speed_table,
)
from nsbench.report.tables.error_bar_table import error_bar_table
from nsbench.report.tables.error_table import error_table
from nsbench.report.tables.failure_tables import (
    failures_table,
    seeds_table,
    study_failures_table,
)
from nsbench.report.tables.multiplier_tables import labels_table, selection_table
from nsbench.report.tables.order_table import orders_table
from nsbench.report.tables.reliability_tables import (
    bounds_table,
    expected_table,
    references_table,
)
from nsbench.report.verdict import write_verdict

MAX_NOTES = 3  # of one method on one case: most differ in their numbers only
TAKEN_PREFIXES = (  # of ids and files
    "scene_",
    "cost_",
    "study-",
    "orders-",
    "errors-",
    "references-",
    "citations-",
    "runs-",
)
MAX_DRAWN_CASES = 100  # cases with figures: a page of more could not be opened


@dataclass(frozen=True)
class Figures:
    """All figures of a report.

    summaries, looks: by (case, method) and by method. ids: by case, also a file name. panels: SVG
    elements for the page by case. files: standalone SVG by file name. talk: SVG, "" if
    there is none. profiles, scaling: SVG elements of the section on speed.
    """

    summaries: dict[tuple, Summary]
    looks: dict
    ids: dict[str, str]
    panels: dict[str, list[str]]
    files: dict[str, str]
    talk: str
    profiles: tuple[str, ...]
    scaling: tuple[str, ...]


def assign_ids(names: Iterable[str]) -> dict[str, str]:
    """Assign a distinct id, also a file name, to each case.

    The ids of the page's sections and controls are taken.
    """
    out = {}
    taken = {
        "talk",
        "verdict",
        "answer",
        "explore",
        "payload",
        "chips",
        "orders",
        "cases",
        "trust",
        "speed",
        "failures",
        "environment",
        "q",
        "ref",
        "profiles",
        "scaling",
        "studies",
    }
    for name in names:
        base = new = file_stem(name)
        k = 2
        while new.lower() in taken or new.lower().startswith(TAKEN_PREFIXES):
            new = f"case_{base}" if k == 2 else f"case_{base}_{k}"
            k = k + 1
        taken.add(new.lower())
        out[name] = new
    return out


def draw_figures(data: Data) -> Figures:
    """Draw every panel once; the page and the files share them."""
    summaries = summarise(data)
    look = assign_looks(data.specs)
    ids = assign_ids(data.case_keys)
    names = {one.index: spec for spec, one in look.items()}
    inlined = {}
    files = {}
    for k, case in enumerate(data.case_keys):
        runs = [r for r in data.of_case(case) if summaries[case, r.solver].word != "refused"]
        legend = [(r.solver, look[r.solver], r.loop == "host") for r in runs]
        inlined[case] = []
        for file, found in (
            (ids[case], case_panels(runs, look, summaries)),
            (f"cost_{ids[case]}", cost_panels(runs, look)),
        ):
            if found and k < MAX_DRAWN_CASES:
                drawn = [draw_panel(p) for p in found]
                inlined[case] += [
                    inline_svg(svg, names, f"{p.title}, {case}")
                    for svg, p in zip(drawn, found, strict=True)
                ]
                files[file] = compose_sheet(drawn, legend, case)
    talk = draw_euler_sliding_figure(data).replace("<svg ", '<svg style="background:#fff" ', 1)
    if talk:
        files["talk"] = talk
    legend = [(spec, look[spec], False) for spec in data.specs]
    over = [
        svg
        for svg in (performance_profiles.draw_profile(data, t, look) for t in cost.TARGETS)
        if svg
    ]
    sizes = [draw_panel(p) for p in scaling.scaling_panels(data, look)]
    files |= {
        name: compose_sheet(group, legend, title)
        for name, group, title in (
            ("profiles", over, "Time to error"),
            ("scaling", sizes, "Cost against size"),
        )
        if group
    }
    page = lambda group, label: tuple(inline_svg(svg, names, label) for svg in group)
    return Figures(
        summaries,
        look,
        ids,
        inlined,
        files,
        talk,
        page(over, "Time to error"),
        page(sizes, "Cost against size"),
    )


def assemble_content(
    data: Data, drawn: Figures, studies: tuple[StudySection, ...] = ()
) -> Content:
    """Compute tables and sentences, and put them around the figures."""
    s = drawn.summaries
    shown = without_refusals(s)
    built = [
        ranking_table(data, shown),
        choice_table(data, s),
        orders_table(shown),
        speed_table(data, s),
        seeds_table(data),
        failures_table(data),
        study_failures_table(studies),
        coarsest_table(data),
        environment_table(data.env),
        citation_table(data.specs),
        glossary_table(data),
        expected_table(judge_expectations(data, s)),
        bounds_table(data, shown),
        error_bar_table(s),
        references_table(data, s),
        selection_table(data, s),
        labels_table(data, s),
        error_table(data),
        scaling.scaling_table(data),
        scaling.sizes_table(data),
        clock_table(data),
    ]
    lede = ", ".join(filter(None, (counts_line(s), *_where(data.env))))
    missing = f" {data.missing}." if data.missing else ""
    factors = tuple(cost.compare_speeds(data)) or (
        "No two methods reached the same error with loops of one kind.",
    )
    with_pbd = any(pushes_contacts(data, one) for one in s.values())
    notes = {case: write_case_notes(data, case, s) for case in data.case_keys}
    return Content(
        title="nsbench report",
        lede=f"{lede}.{missing}",
        headline=write_headline(data, s),
        statements=cite_studies(write_verdict(data, s), studies, with_pbd),
        tables={t.key: t for t in built},
        data=data,
        summaries=s,
        looks=drawn.looks,
        ids=drawn.ids,
        panels=drawn.panels,
        notes=notes,
        speeds=factors,
        talk=drawn.talk,
        talk_sentence=describe_euler_sliding_figure(data),
        profiles=drawn.profiles,
        scaling=drawn.scaling,
        cheapest=tuple(
            [*scaling.describe_wins(data), *performance_profiles.describe_profiles(data)]
        ),
        repeat=repeat_lines(data.env),
        citation=citation(data.env, data.specs, len(data.case_keys)),
        studies=studies,
    )


def pushes_contacts(data: Data, summary: Summary) -> bool:
    """Did PBD give numbers on a case with constraints? True where nothing is stored of the case."""
    families = data.cases.get(summary.case, {}).get("families", True)
    return method_of(summary.solver) == LEADING_METHOD and summary.word == "ok" and bool(families)


def _where(env: dict) -> list[str]:
    """Version and machine, as far as the study stored them."""
    version = version_of(env)
    cores = env.get("cores")
    return [
        f"nsbench {version}" if version else "",
        sanitise(env.get("processor") or env.get("machine") or "", 60),
        f"{sanitise(cores, 8)} cores" if cores else "",
    ]


def _name_steps_for_violation(ladders: list[Runs], target: float, limit: str) -> list[str]:
    """Say with which step each method violates by at most `target`, and which ones never do."""
    found = {r.solver: cost.step_for_violation(r, target) for r in ladders if r.violates}
    costs = [c for c in found.values() if c is not None]
    beyond = [solver for solver, c in found.items() if c is None]
    reached = "; ".join(
        f"{c.solver} h = {format_number(c.h)}{', the largest tried' if c.at_most else ''} "
        f"({format_seconds(c.seconds)})"
        for c in costs
    )
    not_by = f"{'; not' if costs else 'not'} by {', '.join(beyond)} at the steps tried"
    return [f"Violation below {limit}: {reached}{not_by if beyond else ''}."] if found else []


def write_case_notes(data: Data, case: str, summaries: dict[tuple, Summary]) -> list[str]:
    """Write the sentences below the docstring of one case.

    They say why there is no number, where multipliers are not unique, which step keeps the
    constraints, and what methods noted of their own runs.
    """
    own = [s for (c, _), s in summaries.items() if c == case]
    out = []
    if not any(s.word == "ok" for s in own):
        out.append("No run of this case gave a number; the sentences below say why.")
    if data.case_keys.index(case) >= MAX_DRAWN_CASES:
        out.append(f"Figures are drawn for the first {MAX_DRAWN_CASES} cases of a study.")
    why = explain_reactions({(case, s.solver): s for s in own}).get(case, "")
    if why and why != NOT_UNIQUE:
        out.append(f"{why[0].upper()}{why[1:]}.")
    if why == NOT_UNIQUE:
        out.append(
            "The multipliers are not unique here: the reaction is compared instead, and what a "
            "method picks among the multipliers is drawn apart, as its selection; it is not an "
            "error."
        )
    # per cents of the diameter of particles or the stated size, else parts of the unit of length
    length = data.cases.get(case, {}).get("own_length")
    for part in (1e-2, 1e-3):
        target = part * (length or 1.0)
        of_length = f"{100 * part:g} % of the diameter or stated size ({format_number(target)})"
        limit = of_length if length else format_power(part)
        out += _name_steps_for_violation([s.runs for s in own], target, limit)
    with_steps = [s.runs for s in own if s.runs.accuracy == "h" and not s.runs.violates]
    kept = [r.solver for r in with_steps if np.isfinite(r.col["feasibility"][r.good]).any()]
    if kept and data.cases.get(case, {}).get("families", True):
        out.append(f"No step tried violates by more than rounding: {', '.join(kept)}.")
    for runs in data.of_case(case):
        noted = dict.fromkeys(n for n in runs.col["note"] if n)
        out += [f"{runs.solver}: {sanitise(n)}" for n in list(noted)[:MAX_NOTES]]
    return out
