"""Write the report as Markdown: the same sentences and tables as the page."""

from __future__ import annotations

from nsbench.report.content import (
    MEASURED,
    TRUST_TABLES,
    Content,
    describe_problem,
    split_docstring,
)
from nsbench.report.cost import COMPARISON_RULE
from nsbench.report.style import escape_markdown
from nsbench.report.tables.cells import Table
from nsbench.report.tables.reliability_tables import describe_reference


FAILURE_TABLES = (  # below that of the runs: key of Content.tables, heading
    ("study-failures", "Cells of studies that did not end well"),
    ("coarsest", "With the largest steps"),
    ("seeds", "Over seeds"),
)


def render_markdown(c: Content) -> str:
    """Render the whole report; figures are linked from ``figures/``."""
    out = [f"# {escape_markdown(c.title)}", escape_markdown(c.lede), "## What the runs say"]
    for s in c.statements:
        out.append(
            f"**{escape_markdown(s.head)}**\n\n"
            + "\n".join(f"- {escape_markdown(x)}" for x in s.sentences)
        )
    out += [
        *(render_table(c.tables[key]) for key in ("ranking", "choice")),
        "## Orders",
        render_table(c.tables["orders"]),
        "## Case by case",
    ]
    for case in c.data.case_keys:
        known = c.data.cases.get(case, {})
        first, equations = split_docstring(known.get("doc"))
        out += [
            f"### {escape_markdown(case)}",
            escape_markdown(describe_problem(known, c.data.of_case(case))),
        ]
        out += [escape_markdown(first)] if first else []
        out += ["\n".join("    " + line for line in equations.splitlines())] if equations else []
        out += [escape_markdown(n) for n in c.notes[case]]
        out += [escape_markdown(describe_reference(c.data, case, c.is_unique(case)))]
        if c.panels[case]:
            out += [f"![{escape_markdown(case)}](figures/{c.ids[case]}.svg)"]
            out += [f"![{escape_markdown(case)}: cost](figures/cost_{c.ids[case]}.svg)"]
    if c.talk:
        out += ["## The talk's figure", escape_markdown(c.talk_sentence)]
        out += ["![The talk's figure](figures/talk.svg)"]
    out += ["## What the numbers rest on"]
    for key, head in TRUST_TABLES:
        if c.tables[key].rows or c.tables[key].note:
            out += [f"### {head}", render_table(c.tables[key])]
    out += [
        "## Speed at equal error",
        "\n".join(f"- {escape_markdown(s)}" for s in (*c.speeds, *c.cheapest)),
        COMPARISON_RULE,
    ]
    out += ["![Time to error over all cases](figures/profiles.svg)"] if c.profiles else []
    out += [render_table(c.tables["sizes"])] if c.tables["sizes"].rows else []
    out += ["![Cost against size](figures/scaling.svg)"] if c.scaling else []
    out += [render_table(c.tables["scaling"])] if c.tables["scaling"].rows else []
    out += [render_table(c.tables["speed"]), "### The clock", render_table(c.tables["clock"])]
    out += _studies(c)
    out += ["## Failures and refusals", render_table(c.tables["failures"])]
    for key, head in FAILURE_TABLES:
        out += [f"### {head}", render_table(c.tables[key])] if c.tables[key].rows else []
    out += [
        "## Repeat, cite; machine, versions, words",
        f"```text\n{c.repeat}\n```",
        f"```bibtex\n{c.citation}\n```",
        render_table(c.tables["citations"]),
        render_table(c.tables["environment"]),
        MEASURED,
        render_table(c.tables["glossary"]),
    ]
    return "\n\n".join(part for part in out if part) + "\n"


def _studies(c: Content) -> list[str]:
    """Paragraphs of the section on studies; [] without any."""
    out = ["## Studies: questions and answers"] if c.studies else []
    for study in c.studies:
        out += [f"### {escape_markdown(study.question)}"]
        out += [f"**{escape_markdown(study.short)}**"] if study.short else []
        out += [escape_markdown(study.answer)]
        out += ["\n".join(f"- {escape_markdown(text)}" for text in study.evidence)]
        out += [f"![{escape_markdown(f.caption)}]({f.file})" for f in study.figures]
        for title, t in study.tables:
            out += [f"#### {escape_markdown(title)}", render_table(t)]
        out += [
            escape_markdown(f"What would refute it: {study.refutation}"),
            f"Repeat it with `{study.command.replace('`', '')}`. {escape_markdown(study.note)}",
        ]
    return out


def render_table(t: Table) -> str:
    """Render a table; its group becomes a first column, and dots follow a cell that spans."""
    if not t.rows:
        return escape_markdown(t.note)
    grouped = any(r.group for r in t.rows)
    columns = (["case"] if grouped else []) + [escape_markdown(k) for k in t.columns]
    lines = [columns, ["---"] * len(columns)]
    for row in t.rows:
        line = [escape_markdown(row.group)] if grouped else []
        for c in row.cells:
            line.append(escape_markdown(f"{c.text} ({c.small})" if c.small else c.text))
            line += ["…"] * (c.span - 1)
        lines.append(line)
    note = f"\n\n{escape_markdown(t.note)}" if t.note else ""
    return "\n".join("| " + " | ".join(line) + " |" for line in lines) + note
