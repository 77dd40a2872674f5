"""Tabulate the machine and versions of a study and the glossary; say how to repeat and cite it."""

from __future__ import annotations

import shlex
from collections.abc import Collection

import numpy as np

from nsbench.columns import describe
from nsbench.report.data import Data
from nsbench.report.style import (
    format_count,
    sanitise,
)
from nsbench.report.summary import (
    Summary,
)
from nsbench.report.tables.cells import Cell, Row, Table
from nsbench.report.tables.citation_table import bibtex_of

ENTRIES = {  # of env.json, in words
    "schema": "format of the tables",
    "cores": "logical cores",
    "began": "runs began",
    "written": "tables written",
    "load_at_start": "load average over 1, 5, 15 minutes as runs began",
    "load": "load average over 1, 5, 15 minutes as tables were written",
    "argv": "arguments of nsbench",
    "package": "digest of the package",
}
UNKNOWN_VERSION = "VERSION"  # where the version of nsbench is written that a study did not store


def _plain(value) -> str:
    """A stored value as plain text."""
    if isinstance(value, dict):
        return ", ".join(f"{k} {v}" for k, v in value.items())
    return " ".join(map(str, value)) if isinstance(value, (list, tuple)) else str(value)


def environment_table(env: dict) -> Table:
    """Build the table of env.json, one line per entry, with a remark on the load."""
    rows = [
        Row(
            (
                Cell(sanitise(ENTRIES.get(k, k), 80), kind="method"),
                Cell(sanitise(_plain(v)) or "empty"),
            )
        )
        for k, v in env.items()
    ]
    return Table(
        "environment",
        ("what", "value"),
        tuple(rows),
        describe_load(env)
        if rows
        else "The study stored no environment: its figures cannot be tied to a machine.",
    )


def describe_load(env: dict) -> str:
    """Say how busy the machine was while runs were timed, as far as the study stored it."""
    loads = [_first_number(env.get(name)) for name in ("load_at_start", "load")]
    cores = _first_number([env.get("cores")])
    start, end = loads
    if end is None:
        return "The load of the machine during the runs was not recorded."
    at = f"{start:g} at the start and {end:g} at the end" if start is not None else f"{end:g}"
    text = (
        f"Load average over a minute: {at}, the workers of the bench included where they were at "
        "work; between these times it was not measured."
    )
    if cores is not None and max(x for x in loads if x is not None) > cores:
        text += f" That is more than the {cores:g} cores: some seconds are too large."
    return text


def _first_number(stored: object) -> float | None:
    """Return the first entry of a stored list as a number; None if it is none."""
    first = stored[0] if isinstance(stored, list) and stored else None
    is_number = isinstance(first, (int, float)) and not isinstance(first, bool)
    return float(first) if is_number and abs(first) < 1e9 else None


def repeat_lines(env: dict) -> str:
    """Write the commands that make the rows and the page again, and the lines of a figure."""
    stored = env.get("argv")
    argv = [str(a) for a in stored] if isinstance(stored, list) and stored else ["run"]
    stored = env.get("folder")
    out = stored if isinstance(stored, str) and stored else "results"
    folder = sanitise(shlex.quote(out))
    rows = sanitise(repr(f"{out}/runs.parquet"))
    return f"""\
# nsbench {version_of(env) or UNKNOWN_VERSION}, installed as its README says
nsbench {sanitise(shlex.join(argv))}
nsbench report {folder}        # this page, from the rows in {folder}
nsbench run CASE -s METHOD -o again    # all its runs; of one: --h STEP (or --tol, --k), which
                                       # "All runs" of a case shows, "steps in full" ticked

# work-precision of a case, from runs.parquet (or runs.csv), which holds every number of this page
import matplotlib.pyplot as plt, pandas
rows = pandas.read_parquet({rows})
for name, runs in rows[rows["case"] == rows["case"][0]].groupby("solver"):
    runs = runs[runs["status"] == "ok"].sort_values("seconds")
    plt.loglog(runs["seconds"], runs["state_sup"], "o-", label=name)
plt.legend(), plt.xlabel("seconds"), plt.ylabel("state error")
plt.savefig("work_precision.pdf")"""


def citation(env: dict, specs: Collection[str] = (), cases: int = 0) -> str:
    """Write the BibTeX entries of the report (of `cases` cases, where it has any), of the bench, of
    the method that it grew out of, and of `specs`.
    """
    package = f"package {sanitise(env.get('package', 'unknown'), 80)}"
    version = version_of(env) or UNKNOWN_VERSION
    report = f"""\
@misc{{nsbench-report,
  title   = {{Report of nsbench {version} on {cases} cases with {len(specs)} methods}},
{_year_of(env)}  note    = {{runs of {_day_of(env)}, {package}}}
}}
"""
    return f"""\
{report if cases else ""}@software{{nsbench,
  author  = {{{{the nsbench developers}}}},
  title   = {{nsbench: a test bench for Filippov and complementarity systems of first order}},
  version = {{{version}}},
{_year_of(env)}  note    = {{{package}}}
}}
{bibtex_of(specs)}"""


def _day_of(env: dict) -> str:
    """Return the day on which the runs were made; "an unknown day" where it is not stored."""
    return sanitise(env.get("written") or "", 40)[:10] or "an unknown day"


def _year_of(env: dict) -> str:
    """Write the BibTeX line of the year in which the runs were made; "" where it is not stored."""
    year = sanitise(env.get("written") or "", 40)[:4]
    return f"  year    = {{{year}}},\n" if year.isdigit() else ""


def version_of(env: dict) -> str:
    """Return the version of nsbench that a study stored; "" where it has none."""
    versions = env.get("versions")
    known = versions.get("nsbench") if isinstance(versions, dict) else None
    return sanitise(known or "", 40)


GLOSSARY = {  # words of the report that are no columns; those are described in nsbench.columns
    "PBD": "position-based dynamics: a step of explicit Euler, then a projection onto each "
    "violated constraint, one after the other",
    "sweep": "one pass over all constraints in which each violated one is projected onto in turn",
    "ladder": "the runs of one method on one case with smaller and smaller steps",
    "catching-up": "a step of explicit Euler, then one projection onto all linearised constraints "
    "together, by a QP",
    "the talk": "the talk on PBD for ODEs with inequality constraints from which this bench grew; "
    "its figures and its claim of a factor 100 are examined here",
    "order, interval": "p of error = C h^p (1 + r h^q)^s in the fit window, the slope of log "
    "error over log h that the error tends to, with its t-based 95 % interval; kept negative when "
    "a method diverges",
    "constant": "C in error = C h^p, of the finest steps",
    "exact at grid times": "the error is rounding at every step, so that no order can be fitted "
    "(Euler is exact for a constant drift)",
    "plateau": "the error tends to C > 0: the method converges to a limit of its own",
    "pre-asymptotic, undecided": "too few points, or too erratic, for a verdict; an answer, not "
    "an omission",
    "reference floor": "an error below it says more of the reference than of the method and is "
    "not a number",
    "counted work": "drift calls + projections + inner iterations (QP solves where those are not "
    "counted)",
    "compiled, host": "whether the loop over steps runs as machine code or in the Python "
    "interpreter; seconds are compared only within a kind",
    "claimed": f"the order a solver's file claims. A deviation is marked when the claim lies "
    f"outside the interval and more than {0.1:g} away",
}


def glossary_table(data: Data) -> Table:
    """Build the table of words: those of the report, then the columns that hold a value."""
    rows = [Row((Cell(k, kind="method"), Cell(v))) for k, v in GLOSSARY.items()]
    for name in _columns_with_values(data):
        column = describe(name)
        title = column.title if column.title == name else f"{column.title} ({name})"
        unit = f" [{column.unit}]" if column.unit else ""
        rows.append(
            Row((Cell(sanitise(title, 80), kind="method"), Cell(f"{column.meaning}{unit}")))
        )
    return Table("glossary", ("word", "meaning"), tuple(rows))


def _columns_with_values(data: Data) -> list[str]:
    """Names of the columns in which some run of the study holds a value."""
    with_values: dict = {}
    for runs in data.runs.values():
        for name, values in runs.col.items():
            if name not in with_values and np.any(
                np.isfinite(values) if values.dtype == np.float64 else values != ""
            ):
                with_values[name] = None
    first = next(iter(data.runs.values()), None)
    return [name for name in (first.col if first else ()) if name in with_values]


def counts_line(summaries: dict[tuple, Summary]) -> str:
    """Count runs, methods and cases: ``24 runs of 3 methods on 2 cases``."""
    runs = sum(len(s.runs) for s in summaries.values())
    return (
        f"{format_count(runs, 'run')} of {format_count(len({k[1] for k in summaries}), 'method')} "
        f"on {format_count(len({k[0] for k in summaries}), 'case')}"
    )
