"""Data -> everything the page shows: figures drawn, tables and sentences computed."""

from __future__ import annotations

from dataclasses import dataclass

from nsbench.report import (
    clock_table,
    cost,
    error_table,
    reliability_tables,
    scaling,
    tables,
)
from nsbench.report import (
    performance_profiles as profiles,
)
from nsbench.report.content import Content
from nsbench.report.data import Data
from nsbench.report.expectations import judge_expectations
from nsbench.report.figures import case_panels, cost_panels
from nsbench.report.style import (
    assign_looks,
    file_stem,
    format_number,
    format_power,
    format_seconds,
    sanitise,
)
from nsbench.report.summary import Summary, summarise
from nsbench.report.svg_plots import compose_sheet, draw_panel, inline_svg
from nsbench.report.talk_figure import describe_talk_figure, draw_talk_figure
from nsbench.report.verdict import compare_speeds, write_verdict

MAX_DRAWN_CASES = 100  # cases with figures: a page of more could not be opened


@dataclass(frozen=True)
class Figures:
    """panels: SVG elements for the page by case; files: standalone SVG by file name; talk: for the
    page; profiles, scaling: SVG elements of the section on speed."""

    summaries: dict[tuple, Summary]
    looks: dict
    ids: dict[str, str]
    panels: dict[str, list[str]]
    files: dict[str, str]
    talk: str
    profiles: tuple[str, ...]
    scaling: tuple[str, ...]


def assign_ids(names) -> dict[str, str]:
    """A distinct id, also a file name, per case."""
    out = {}
    taken = {
        "talk",
        "verdict",
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
    }
    for name in names:
        base = new = file_stem(name)
        k = 2
        while new.lower() in taken or new.lower().startswith(("scene_", "cost_")):
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
    talk = draw_talk_figure(data)
    if talk:
        files["talk"] = talk.replace("<svg ", '<svg style="background:#fff" ', 1)
    legend = [(spec, look[spec], False) for spec in data.specs]
    over = [svg for svg in (profiles.draw_profile(data, t, look) for t in cost.TARGETS) if svg]
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
        inline_svg(talk, names, "The talk's figure") if talk else "",
        page(over, "Time to error"),
        page(sizes, "Cost against size"),
    )


def assemble_content(data: Data, drawn: Figures) -> Content:
    """Tables and sentences around the figures."""
    s = drawn.summaries
    made = [
        tables.choice_table(data),
        tables.orders_table(s),
        tables.speed_table(data),
        tables.seeds_table(data),
        tables.failures_table(data),
        tables.environment_table(data.env),
        tables.glossary_table(data),
        reliability_tables.expected_table(judge_expectations(data, s)),
        reliability_tables.bounds_table(data, s),
        reliability_tables.references_table(data),
        reliability_tables.selection_table(data, s),
        reliability_tables.labels_table(data, s),
        error_table.error_table(data),
        scaling.scaling_table(data),
        scaling.sizes_table(data),
        clock_table.clock_table(data),
    ]
    lede = ", ".join(filter(None, (tables.counts_line(s), *_where(data.env))))
    factors = tuple(compare_speeds(data)) or (
        "No two methods reached the same error with loops of one kind.",
    )
    told = {case: write_case_notes(data, case, s) for case in data.case_keys}
    return Content(
        title="nsbench report",
        lede=f"{lede}.",
        statements=tuple(write_verdict(data, s)),
        tables={t.key: t for t in made},
        data=data,
        summaries=s,
        looks=drawn.looks,
        ids=drawn.ids,
        panels=drawn.panels,
        notes=told,
        speeds=factors,
        talk=drawn.talk,
        talk_sentence=describe_talk_figure(data),
        profiles=drawn.profiles,
        scaling=drawn.scaling,
        cheapest=tuple([*scaling.describe_wins(data), *profiles.describe_profiles(data)]),
    )


def _where(env: dict) -> list[str]:
    """Version and machine, as far as the study stored them."""
    versions = env.get("versions")
    version = versions.get("nsbench") if isinstance(versions, dict) else None
    cores = env.get("cores")
    return [
        f"nsbench {sanitise(version, 20)}" if version else "",
        sanitise(env.get("machine") or "", 60),
        f"{sanitise(cores, 8)} cores" if cores else "",
    ]


def write_case_notes(data: Data, case: str, summaries: dict[tuple, Summary]) -> list[str]:
    """What a reader of one case needs to be told beside its figures."""
    mine = [s for (c, _), s in summaries.items() if c == case]
    out = []
    if not any(s.word == "ok" for s in mine):
        out.append("No run of this case gave a number; the sentences below say why.")
    if data.case_keys.index(case) >= MAX_DRAWN_CASES:
        out.append(f"Figures are drawn for the first {MAX_DRAWN_CASES} cases of a study.")
    if any(s.force.metric == "reaction" for s in mine):
        out.append(
            "The multipliers are not unique here: the reaction is compared instead, and what a "
            "method picks among the multipliers is drawn apart, as its selection; it is not an "
            "error."
        )
    for target in (1e-2, 1e-3):
        found = [cost.step_for_violation(s.runs, target) for s in mine if s.runs.violates]
        found = [c for c in found if c is not None]
        if found:
            told = "; ".join(
                f"{c.solver} h = {format_number(c.h)}{', the largest tried' if c.at_most else ''} "
                f"({format_seconds(c.seconds)})"
                for c in found[:4]
            )
            out.append(f"Violation below {format_power(target)}: {told}.")
    return out
