"""`nsbench run`: plan the runs of cases, solvers and accuracies, and execute them.

Cases are named, or come from files, or are those of a suite; without -s each case gets the standard
solvers and those of the solver files given.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
from collections import Counter
from collections.abc import Callable
from pathlib import Path

from nsbench import solvers
from nsbench.case import broken_cases
from nsbench.case.selection import python_files
from nsbench.cli.exit_codes import FAILED, FINE
from nsbench.cli.option_values import (
    check_accuracies,
    check_cluster_options,
    check_worker_options,
    find_cases,
    read_accuracies,
    read_values,
)
from nsbench.study.plan import Spec, plan_runs, resolve, starts_refused, suite_cases

CaseSource = tuple[str, str]  # key, and the file ("": a registered case)


def command(args: argparse.Namespace, say: Callable[[str], None]) -> int:
    """Execute the runs, or with --plan say which they are; 3 if some failed unexpectedly."""
    from nsbench.execute.suite import execute

    check_worker_options(args)
    check_cluster_options(args)
    solver_files = tuple(str(p) for f in args.solver_files for p in python_files(f))
    added_solvers = [solvers.load(f) for f in solver_files]
    solver_files += tuple(solvers.plugin_files(args.solver or ()))
    values = {name: read_values(text) for name, text in read_accuracies(args).items()}
    check_accuracies(args.solver or (), list(values))
    cases, left_out = _select_cases(args)
    _check_distinct_names(cases)
    specs = _plan(args, cases, values, solver_files, added_solvers)
    if not (args.case_files or args.cases or args.solver):
        left_out |= {f"solver {name}": why for name, why in solvers.broken().items()}
    for name, why in left_out.items():
        say(f"left out: {name}: {why}")
    voice = _voice(args, say)
    if args.project_entries:  # a file named on the command line may run with methods of the folder
        voice(f"from nsbench.toml: {', '.join(args.project_entries)}")
    code = execute(specs, Path(args.out), args, voice)
    if args.json and not args.plan:
        say(json.dumps(_describe_results(Path(args.out)), indent=1))
    return code or (FAILED if left_out else FINE)


def _voice(args, say: Callable) -> Callable:
    """Return what `execute` prints with: nothing but the path with -q, nothing with --json."""
    if args.json and not args.plan:
        return lambda text="", end="\n": None
    if not args.quiet:
        return say
    return lambda text="", end="\n": say(text, end) if text.startswith("report: ") else None


def _describe_results(out: Path) -> dict:
    """Return what the table at the end says, with the counted statuses, for other programs."""
    from nsbench.report.data import read
    from nsbench.report.overview import overview

    data = read(out)
    statuses = Counter(str(s) for r in data.runs.values() for s in r.col["status"])
    lines = [dataclasses.asdict(line) for line in overview(data)]
    cases = [{k: None if v != v else v for k, v in line.items()} for line in lines]
    return {"report": str(out / "report.html"), "statuses": statuses, "cases": cases}


def _select_cases(args) -> tuple[list[CaseSource], dict[str, str]]:
    """Cases of the arguments; and why cases of the suite that do not load are not among them."""
    names = [*args.cases, *args.case_files]
    if not names:
        left_out = broken_cases()
        return [(k, "") for k in suite_cases(args.suite, args.tag, left_out)], left_out
    found = [(c, f) for c, f in find_cases(names, args.suite, args) if args.tag in (None, *c.tags)]
    refused = starts_refused(c for c, f in found if f)
    if refused and len(refused) == len(found):
        raise ValueError("; ".join(refused.values()))
    return [(c.key, f) for c, f in found if c.key not in refused], refused


def _plan(args, cases, values, solver_files, added_solvers) -> list[Spec]:
    """Plan all runs. Raises LookupError if there are none."""
    references = str(Path(args.references or Path(args.out) / "references").resolve())
    specs = plan_runs(cases, args.solver, values, solver_files, references)
    if not specs:
        raise LookupError("nothing to run: no case matches")
    if added_solvers and args.solver is None:
        more = plan_runs(cases, added_solvers, values, solver_files, references)
        specs += [s for s in more if s not in specs]
    return specs


def _check_distinct_names(cases: list[CaseSource]) -> None:
    """Raise ValueError, with both files, if the names of two cases differ by at most their case.

    Files of results are named after cases, and some file systems do not distinguish these.
    """
    first_of: dict[str, CaseSource] = {}
    for key, file in dict.fromkeys(cases):
        first = first_of.setdefault(key.casefold(), (key, file))
        if first != (key, file):
            where = [f or resolve(k).source for k, f in (first, (key, file))]
            raise ValueError(
                f"two cases are named alike: {first[0]} in {where[0]} and {key} in {where[1]}"
            )
