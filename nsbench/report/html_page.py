"""The page: one HTML file that needs nothing else. Every text goes through `html`; stored pictures
are images."""

from __future__ import annotations

import base64
import re
from dataclasses import dataclass
from textwrap import dedent

from nsbench.report.cost import RULE
from nsbench.report.data import Data, Runs
from nsbench.report.sheet import CSS, SCRIPT
from nsbench.report.style import SHAPES, Look, escape, sanitise
from nsbench.report.summary import Summary
from nsbench.report.svg_plots import DASHES, inline, markers
from nsbench.report.tables import Table
from nsbench.report.verdict import Statement


@dataclass(frozen=True)
class Content:
    """Everything the page shows, in order; `text` writes the same as Markdown.

    tables: by key (choice, orders, speed, seeds, failures, environment, glossary, those of TRUST);
    panels: inlined SVG by case;
    notes: sentences under a case; talk: SVG or "", told: its sentence; title and lede: of the
    header; profiles, scaling: SVG;
    wins: who is cheapest where.
    """

    title: str
    lede: str
    statements: tuple[Statement, ...]
    tables: dict[str, Table]
    data: Data
    summaries: dict[tuple, Summary]
    looks: dict[str, Look]
    ids: dict[str, str]
    panels: dict[str, list[str]]
    notes: dict[str, list[str]]
    speeds: tuple[str, ...]
    talk: str = ""
    told: str = ""
    profiles: tuple[str, ...] = ()
    scaling: tuple[str, ...] = ()
    wins: tuple[str, ...] = ()


READING = (
    "An open marker on the bottom edge is an error of exactly 0, a figure there an error far "
    "below the others; a "
    "cross on the top edge is a run that gave no number, a dotted line the best error of a method "
    "with a "
    "tolerance. Triangles show the orders claimed; the shaded band is the reference's own error. "
    "Where cost is "
    "shown, open markers are host loops."
)


TRUST = (
    ("expected", "Expected against observed"),
    ("bounds", "Methods that claim a bound"),
    ("selection", "Multipliers that are not unique"),
    ("labels", "Where in its step a multiplier belongs"),
    ("references", "References and their own error"),
)


def page(c: Content) -> str:
    """The whole document."""
    sections = [
        ("verdict", "What the runs say", _verdict(c)),
        ("orders", "Orders", _tools() + table(c.tables["orders"], c.looks)),
        (
            "cases",
            "Case by case",
            f'<p class="note">{escape(READING)}</p>'
            + "".join(_case(c, case) for case in c.data.case_keys),
        ),
    ]
    if c.talk:
        shown = f'<p class="note">{escape(c.told)}</p><div class="talk">{c.talk}</div>'
        sections.append(("talk", "The talk's figure", shown))
    trust = "".join(
        f"<h3>{escape(head)}</h3>{table(c.tables[key], c.looks, 'list text' if key == 'references' else '')}"
        for key, head in TRUST
        if c.tables[key].rows or c.tables[key].note
    )
    sections.append(("trust", "What the numbers rest on", trust))
    sections.append(("speed", "Speed at equal error", _speed(c)))
    seeds = (
        "<h3>Over seeds</h3>" + table(c.tables["seeds"], c.looks) if c.tables["seeds"].rows else ""
    )
    sections += [
        (
            "failures",
            "Failures and refusals",
            table(c.tables["failures"], c.looks, "list text") + seeds,
        ),
        (
            "environment",
            "Machine, versions, words",
            table(c.tables["environment"], c.looks, "list")
            + f'<p class="note">{escape(MEASURED)}</p>'
            + table(c.tables["glossary"], c.looks, "list text"),
        ),
    ]
    body = "".join(
        f'<section id="{key}"><h2>{escape(head)}</h2>{content}</section>\n'
        for key, head, content in sections
    )
    links = "".join(f'<a href="#{key}">{escape(head)}</a>' for key, head, _ in sections)
    cases = " ".join(f'<a href="#{c.ids[k]}">{escape(k)}</a>' for k in c.data.case_keys)
    more = (
        f"<details><summary>{len(c.data.case_keys)} cases</summary>{cases}</details>"
        if cases
        else ""
    )
    marks = inline(
        f'<svg width="0" height="0" style="position:absolute">{markers(c.looks.values())}</svg>',
        {},
        "",
    )
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta name="viewport" '
        f'content="width=device-width,initial-scale=1"><title>{escape(c.title)}</title>'
        f"<style>{CSS}</style></head>\n<body><main><header><h1>{escape(c.title)}</h1>"
        f"<p "
        f'class="lede">{escape(c.lede)}</p><nav>{links}{more}</nav></header>\n{marks}{body}</main>'
        f"<script>{SCRIPT}</script></body></html>\n"
    )


def _speed(c: Content) -> str:
    """Factors, profiles over all cases, cost against size; every table with its note."""
    parts = [_list(c.speeds, c.looks), f'<p class="note">{escape(RULE)}</p>']
    for head, drawn, told, key in (
        ("Time to error over all cases", c.profiles, _list(c.wins, c.looks), "sizes"),
        ("Cost against size", c.scaling, "", "scaling"),
    ):
        if drawn or c.tables[key].rows:
            legend = _items(c.looks.items())
            figures = f'{legend}<div class="panels">{"".join(drawn)}</div>' if drawn else ""
            told += f'<p class="note">{escape(SHARES)}</p>' if key == "sizes" else ""
            parts.append(
                f"<article "
                f'class="case"><h3>{head}</h3>{told}{figures}{table(c.tables[key], c.looks)}</article>'
            )
    return (
        "".join(parts)
        + "<h3>Every case</h3>"
        + table(c.tables["speed"], c.looks)
        + "<h3>The clock</h3>"
        + table(c.tables["clock"], c.looks)
    )


SHARES = (
    "Each curve tells on which share of the cases a method gets to the error within so many times "
    "the seconds of the "
    "fastest (performance profiles of Dolan & More, 2002), compiled loops alone. A case that a "
    "method refuses, was not "
    "run on, or does not solve to this error counts against it; where its coarsest run is already "
    "better, the seconds "
    "of that run count."
)
MEASURED = (
    "Compilation, set-up and factorisation are timed apart from the run; only the run is shown. "
    "Compare "
    "seconds within this study: they depend on the machine and its load. Errors and residuals are "
    "computed by "
    "the bench from the trajectory, never taken from a solver's word."
)


def _verdict(c: Content) -> str:
    parts = "".join(
        f'<h3 class="{s.tone}">{escape(s.head)}</h3>{_list(s.sentences, c.looks, s.tone)}'
        for s in c.statements
    )
    return f'<div class="say">{parts}</div>' + table(c.tables["choice"], c.looks)


def _list(sentences, looks: dict, tone: str = "plain") -> str:
    """Sentences as a list; methods are named with their mark."""
    items = "".join(f"<li>{marked(s, looks)}</li>" for s in sentences)
    return f'<ul class="{tone}">{items}</ul>' if items else ""


def marked(sentence: str, looks: dict) -> str:
    """`sentence` as HTML, every method's name in it with its chip."""
    if not looks:
        return escape(sentence)
    names = "|".join(re.escape(n) for n in sorted(looks, key=len, reverse=True))
    parts = re.split(rf"(?<![\w\[=,])({names})(?![\w\[=])", sentence)
    return "".join(
        f'<span class="m">{chip(looks[p])}{escape(p)}</span>'
        if i % 2
        else re.sub(r"\d[\d.]*e-\d+", r'<span class="n">\g<0></span>', escape(p))
        for i, p in enumerate(parts)
    )


def _tools() -> str:
    return (
        '<div class="tools"><input id="q" type="search" placeholder="case or method" '
        'aria-label="filter the table">'
        '<label><input id="ref" type="checkbox" checked> refusals</label></div>'
    )


def chip(look: Look, hollow: bool = False) -> str:
    """A method's mark: its marker in its colour."""
    fill = "none" if hollow else f"var(--m{look.tone})"
    return (
        f'<svg class="chip" viewBox="0 0 12 12" aria-hidden="true"><path '
        f'd="{SHAPES[look.marker]}" fill="{fill}" '
        f'stroke="var(--m{look.tone})"/></svg>'
    )


def _key(look: Look) -> str:
    """A method's mark on a piece of its line, for legends."""
    return (
        f'<svg class="chip key" viewBox="0 0 28 12" aria-hidden="true"><path d="M0 6h28" '
        f'fill="none" stroke-width="1.4" '
        f'stroke="var(--m{look.tone})" stroke-dasharray="{DASHES[look.line]}"/><path '
        f'transform="translate(8 0)" '
        f'd="{SHAPES[look.marker]}" fill="var(--m{look.tone})" stroke="var(--m{look.tone})"/></svg>'
    )


def table(t: Table, looks: dict[str, Look], kind: str = "") -> str:
    """`t` as HTML; a change of group opens with a heading row."""
    if not t.rows:
        return f'<p class="note">{escape(t.note)}</p>' if t.note else ""
    rows = []
    group = ""
    for row in t.rows:
        if row.group != group:
            group = row.group
            rows.append(
                f'<tr class="group"><th colspan="{len(t.columns)}" '
                f'scope="rowgroup">{escape(group)}</th></tr>'
            )
        cells = "".join(_cell(c, looks) for c in row.cells)
        rows.append(f'<tr data-case="{escape(row.group)}" data-kind="{row.kind}">{cells}</tr>')
    head = "".join(f'<th scope="col">{escape(c)}</th>' for c in t.columns)
    note = f'<p class="note">{escape(t.note)}</p>' if t.note else ""
    return (
        f'<div class="wrap"><table id="t-{t.key}" '
        f'class="{kind}"><thead><tr>{head}</tr></thead>\n<tbody>'
        + "\n".join(rows)
        + f"</tbody></table></div>{note}"
    )


def _cell(c, looks: dict) -> str:
    mark = chip(looks[c.text]) if c.kind in ("method", "best") and c.text in looks else ""
    text = escape(c.text)
    if c.kind in ("flag", "bad"):
        text = f"<b>{text}</b>"
    elif c.kind in ("method", "best"):
        text = re.sub(r"(?<=[_\[,])", "<wbr>", text)  # where a name may break on a narrow screen
    elif c.span > 1:
        text = f"<div>{text}</div>"
    small = f"<small>{escape(c.small)}</small>" if c.small else ""
    span = f' colspan="{c.span}"' if c.span > 1 else ""
    title = f' title="{escape(c.title)}"' if c.title else ""
    return f'<td class="{c.kind}"{span}{title}>{mark}{text}{small}</td>'


def _case(c: Content, case: str) -> str:
    runs = c.data.of_case(case)
    known = c.data.cases.get(case, {})
    picture = ""
    wide = ""
    if case in c.data.pictures:
        code = base64.b64encode(c.data.pictures[case].encode()).decode()
        aspect = _aspect(c.data.pictures[case])
        wide = (
            " wide" if aspect > 2.5 else " broad" if aspect > 1.5 else ""
        )  # frames side by side, a plane, a box
        picture = (
            f'<img class="scene" alt="The scene of {escape(case)}" '
            f'src="data:image/svg+xml;base64,{code}">'
        )
    drawn = c.panels[case]
    figures = f'{_legend(runs, c)}<div class="panels">{"".join(drawn)}</div>' if drawn else ""
    notes = "".join(f"<p>{marked(s, c.looks)}</p>" for s in c.notes[case])
    return (
        f'<article class="case" id="{c.ids[case]}"><h3>{escape(case)}</h3>'
        f'<p class="meta">{escape(meta(known, runs))}</p>'
        f'<div class="about{wide}">{picture}<div>{_doc(known.get("doc"))}{notes}</div></div>'
        f"{figures}{_fits(c, case)}</article>\n"
    )


def _aspect(svg: str) -> float:
    """Width over height of an SVG by its viewBox; 1 if it has none."""
    box = re.search(r'viewBox="([^"]*)"', svg)
    try:
        _, _, wide, high = (float(v) for v in box[1].replace(",", " ").split())
        return wide / high
    except (TypeError, ValueError, ZeroDivisionError):
        return 1.0


def meta(known: dict, runs: list[Runs]) -> str:
    """``Complementarity · n = 6 · Affine, Distance · T = 3 · reference: exact``, from what is
    stored; never empty."""
    parts = [sanitise(known[k], 60) for k in ("problem",) if known.get(k)]
    parts += [f"n = {sanitise(known['n'], 12)}"] if known.get("n") is not None else []
    families = known.get("families")
    if families:
        parts.append(
            sanitise(", ".join(map(str, families)) if isinstance(families, list) else families, 200)
        )
    parts += [f"T = {known['T']:g}"] if isinstance(known.get("T"), (int, float)) else []
    kinds = sorted({str(s) for r in runs for s in r.col["reference"] if s}) or [
        known.get("reference") or "none"
    ]
    return " · ".join([*parts, f"reference: {', '.join(sanitise(k, 200) for k in kinds)}"])


def paragraphs(doc) -> tuple[str, str]:
    """The first paragraph of a docstring, and the equations if an indented block follows."""
    blocks = re.split(r"\n\s*\n", str(doc or "").strip("\n"))
    first = " ".join(blocks[0].split())
    then = blocks[1] if len(blocks) > 1 and blocks[1].startswith(("  ", "\t")) else ""
    return sanitise(first), "\n".join(
        sanitise(line, 200) for line in dedent(then.expandtabs()).rstrip().splitlines()[:12]
    )


def _doc(doc) -> str:
    first, equations = paragraphs(doc)
    return (f"<p>{escape(first)}</p>" if first else "") + (
        f"<pre>{escape(equations)}</pre>" if equations else ""
    )


def _legend(runs: list[Runs], c: Content) -> str:
    shown = [r for r in runs if c.summaries[r.case, r.solver].word != "refused"]
    return _items([(r.solver, c.looks[r.solver]) for r in shown])


def _items(shown) -> str:
    items = "".join(
        f'<li data-s="{look.index}">{_key(look)}{escape(name)}</li>' for name, look in shown
    )
    return f'<ul class="legend">{items}</ul>'


def _fits(c: Content, case: str) -> str:
    items = []
    for (key, solver), s in c.summaries.items():
        if key != case:
            continue
        told = [s.outcome] if s.outcome else [o.sentence for o in (s.state, s.force, s.violation)]
        items.append(
            f'<li>{chip(c.looks[solver])}<span class="m">{escape(solver)}</span> '
            f"{escape(' '.join(told))}</li>"
        )
    return (
        f'<details class="fits"><summary>What was fitted, and why '
        f"not</summary><ul>{''.join(items)}</ul></details>"
    )
