"""Plan and run a benchmark study: cases x methods x accuracies, one row per attempted run.

Open questions with their evidence are in nsbench.studies.

    plan              every run to attempt, as a `Spec`
    attempt           one run and its row
    result_contract   does the trajectory that a solver returned keep the contract?
    describe          what a report says of cases and methods
    export            rows for xarray, LaTeX and notebooks

Nothing is printed and no file is written here.
"""

from __future__ import annotations

import dataclasses
import secrets
from collections import Counter
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from nsbench.case import Case
from nsbench.reference import BadReference, build_missing, is_missing, reference
from nsbench.study.attempt import run_batch
from nsbench.study.describe import describe_case, describe_solver
from nsbench.study.export import LATEX_COLUMNS, to_html, to_latex, to_xarray
from nsbench.study.plan import Spec, hand_over, plan_runs, resolve, starts_refused

if TYPE_CHECKING:
    import pandas
    import xarray

__all__ = ["Spec", "Study", "run"]


def _count(what: Collection, word: str) -> str:
    """Return how many there are, with the word for one of them: 1 case, 2 cases."""
    return f"{len(what)} {word}{'s' * (len(what) != 1)}"


@dataclass(frozen=True, repr=False)
class Study:
    """rows: one dict per attempted run, whatever became of it; cases, solvers: what they are, by
    key and spec."""

    rows: list[dict]
    cases: dict = dataclasses.field(default_factory=dict)
    solvers: dict = dataclasses.field(default_factory=dict)

    def __repr__(self) -> str:
        """Return the numbers of rows, cases and solvers, what became of the runs, and the number of
        cases whose errors are not known."""
        outcomes = Counter(row["status"] for row in self.rows)
        counted = ", ".join(f"{count} {status}" for status, count in outcomes.most_common())
        unknown = {r["case"] for r in self.rows if r.get("reference") == "none"}
        blind = f"; errors of {_count(unknown, 'case')} not known: no reference" if unknown else ""
        cases = _count({row["case"] for row in self.rows}, "case")
        solvers = _count({row["solver"] for row in self.rows}, "solver")
        runs = _count(self.rows, "run")
        return f"Study({runs} of {cases} with {solvers}: {counted or 'none'}{blind})"

    def _repr_html_(self) -> str:
        """Return a table with a line per case and solver, for notebooks."""
        return to_html(self.rows, repr(self))

    def to_pandas(self) -> pandas.DataFrame:
        """Return the rows as a pandas DataFrame."""
        import pandas

        return pandas.DataFrame(self.rows)

    def frame(self) -> pandas.DataFrame:
        """Return the rows as a pandas DataFrame: the same as `to_pandas`."""
        return self.to_pandas()

    def to_xarray(self) -> xarray.Dataset:
        """Return the columns as a data set over case, solver and accuracy asked, with units.

        Raises ImportError if xarray is not installed.
        """
        return to_xarray(self.rows)

    def to_latex(self, names: Sequence[str] = LATEX_COLUMNS, digits: int = 3) -> str:
        """Return the rows as a LaTeX tabular of case, solver, accuracy and the columns `names`.

        Raises LookupError for a column that no row has.
        """
        return to_latex(self.rows, names, digits)

    @property
    def plot(self) -> Any:
        """Return the charts of the study: `plot.error()`, `plot.work_precision()`, `plot.orders()`.

        Each returns a nsbench.plots.Chart.
        """
        # by name: pictures lie above what they show, and are imported when one is asked for
        return import_module("nsbench.plots").StudyPlots(self)


def run(
    cases: str | Case | Iterable[str | Case],
    solver_specs: str | Iterable[str] | None = None,
    *,
    h: float | Iterable[float] | None = None,
    tol: float | Iterable[float] | None = None,
    k: float | Iterable[float] | None = None,
    references: str | Path | None = None,
) -> Study:
    """Run cases (keys, or Case objects, as they are) with solvers (specs; None: the standard ones),
    in this process.

    h, tol, k: accuracies that replace the standard ladders. references: folder of references for
    Case objects that have none; one that is missing there is built first, which takes seconds to
    minutes (None: their errors are not known). The command line runs the same rows in supervised
    workers with a journal. Raises ValueError for a Case object whose start violates its constraints
    under a policy that forbids it.
    """
    chosen = dict.fromkeys([cases] if isinstance(cases, (str, Case)) else cases)
    given = [_with_reference(c, references) for c in chosen]
    these = [(c.key, hand_over(c)) if isinstance(c, Case) else (c, "") for c in given]
    if len({key for key, _ in these}) < len(these):
        raise ValueError(f"two cases are named alike: {', '.join(sorted(key for key, _ in these))}")
    refused = starts_refused(c for c in given if isinstance(c, Case))
    if refused:
        raise ValueError("; ".join(refused.values()))
    names = [solver_specs] if isinstance(solver_specs, str) else solver_specs
    given_values = {n: v for n, v in (("h", h), ("tol", tol), ("k", k)) if v is not None}
    values = {n: np.atleast_1d(np.asarray(v, float)).tolist() for n, v in given_values.items()}
    rows = []
    session = secrets.token_hex(6)
    for key, file in these:
        specs = plan_runs([(key, file)], names, values)
        done = dict(run_batch(specs))
        rows += [done[i] | {"session": session} for i in sorted(done)]
    return Study(
        rows,
        {key: describe_case(resolve(key, file)) for key, file in these},
        {spec: describe_solver(spec) for spec in dict.fromkeys(r["solver"] for r in rows)},
    )


def _with_reference(case: str | Case, folder: str | Path | None) -> str | Case:
    """Return a Case with the folder in which its reference lies, built if it has none anywhere."""
    if folder is None or not isinstance(case, Case):
        return case
    try:
        if reference(case) is not None:
            return case
    except BadReference:  # that of a registered case which was changed in Python
        pass
    own = case.replace(references=str(folder))
    if is_missing(own):
        build_missing(own)
    return own
