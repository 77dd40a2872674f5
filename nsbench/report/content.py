"""Dataclass for the content of a report, sentences, tables and figures, whatever its format.

`Content` is filled by nsbench.report.assemble; nsbench.report.html_page and nsbench.report.markdown
write it. What both of them derive from the stored description of a case is here too.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from textwrap import dedent

from nsbench.report.data import Data, Runs
from nsbench.report.study_pages import StudySection
from nsbench.report.style import Look, sanitise
from nsbench.report.summary import Summary
from nsbench.report.tables.cells import Table
from nsbench.report.verdict import Statement

MAX_EQUATION_LINES = 12  # of a docstring; more would push the figures of the case off the screen

# tables of the section on trust, in order: key of Content.tables, heading
TRUST_TABLES = (
    ("expected", "Expected against observed"),
    ("bounds", "Methods that claim a bound"),
    ("error_bars", "Error bars beside the true errors"),
    ("selection", "Multipliers that are not unique"),
    ("labels", "Where in its step a multiplier belongs"),
    ("errors", "Every error and residual at the finest step"),
    ("references", "References and their own error"),
)
MEASURED = (
    "Compilation, set-up and factorisation are timed apart from the run; only the run is shown. "
    "Compare seconds within this study: they depend on the machine and its load. Errors and "
    "residuals are computed by the bench from the trajectory, never taken from a solver's word."
)


@dataclass(frozen=True)
class Content:
    """Everything a report shows, in the order of the page.

    title, lede: of the header. headline: the answer in a sentence. statements: opening sentences.
    tables: by key (ranking, choice, orders, speed, sizes, scaling, clock, seeds, failures,
    study-failures, coarsest, environment, citations, glossary, those of TRUST_TABLES).
    data, summaries: rows and fits, summaries by (case, method). looks: by method. ids: by case.
    panels: SVG elements by case. notes: sentences by case. speeds: factors at equal error.
    talk: SVG of the talk's figure, "" if there is none, with its sentence.
    profiles, scaling: SVG elements. cheapest: who is cheapest where. studies: with their answers.
    repeat, citation: lines to run and to quote.
    """

    title: str
    lede: str
    headline: str
    statements: tuple[Statement, ...]
    tables: dict[str, Table]
    data: Data
    summaries: dict[tuple[str, str], Summary]
    looks: dict[str, Look]
    ids: dict[str, str]
    panels: dict[str, list[str]]
    notes: dict[str, list[str]]
    speeds: tuple[str, ...]
    talk: str = ""
    talk_sentence: str = ""
    profiles: tuple[str, ...] = ()
    scaling: tuple[str, ...] = ()
    cheapest: tuple[str, ...] = ()
    studies: tuple[StudySection, ...] = ()
    repeat: str = ""
    citation: str = ""

    def is_unique(self, case: str) -> bool:
        """Are the multipliers of a case unique, so that each has an error of its own?"""
        own = [s for (name, _), s in self.summaries.items() if name == case]
        return not any(s.force.metric == "reaction" for s in own)


def describe_problem(stored: dict, runs: list[Runs]) -> str:
    """Write the line below a case's name from its stored description; never empty.

    ``Complementarity · n = 6 · Affine, Distance · T = 3 · reference: exact``
    """
    parts = []
    if stored.get("problem"):
        parts.append(sanitise(stored["problem"], 60))
    if stored.get("n") is not None:
        parts.append(f"n = {sanitise(stored['n'], 12)}")
    families = stored.get("families")
    if families:
        names = ", ".join(map(str, families)) if isinstance(families, list) else families
        parts.append(sanitise(names, 200))
    if isinstance(stored.get("T"), (int, float)):
        parts.append(f"T = {stored['T']:g}")
    references = sorted({str(s) for r in runs for s in r.col["reference"] if s})
    references = references or [stored.get("reference") or "none"]
    parts.append(f"reference: {', '.join(sanitise(k, 200) for k in references)}")
    return " · ".join(parts)


def split_docstring(doc: object) -> tuple[str, str]:
    """Return the first paragraph of a docstring, and the indented block after it, the equations.

    Each is "" where it is missing.
    """
    blocks = re.split(r"\n\s*\n", str(doc or "").strip("\n"))
    paragraph = " ".join(blocks[0].split())
    has_equations = len(blocks) > 1 and blocks[1].startswith(("  ", "\t"))
    lines = dedent(blocks[1].expandtabs()).rstrip().splitlines() if has_equations else []
    equations = "\n".join(sanitise(line, 200) for line in lines[:MAX_EQUATION_LINES])
    return sanitise(paragraph), equations
