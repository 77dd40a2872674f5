"""`nsbench calibrate`: spread of the numbers of a study over starts 1e-12 apart."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

from nsbench import solvers
from nsbench.case import plugin_case_names
from nsbench.case.selection import python_files
from nsbench.case.spec import parse_spec
from nsbench.cli.option_values import check_worker_options, find_cases


def command(args: argparse.Namespace, say: Callable[[str], None]) -> int:
    """Run a study again from perturbed starts and store the spreads in its folder."""
    from nsbench.gate.calibrate import UserFiles, calibrate
    from nsbench.report.data import read
    from nsbench.results.consistency import check

    check_worker_options(args)
    check(args.dir)
    solver_files = tuple(str(p) for f in args.solver_files for p in python_files(f))
    for file in solver_files:
        solvers.load(file)
    studied = read(args.dir)
    solver_files += tuple(solvers.plugin_files(studied.specs))
    plugins = plugin_case_names()
    brought = [key for key in studied.case_keys if parse_spec(key)[0] in plugins]
    found = find_cases([*args.case_files, *brought])
    references = str(Path(args.references or Path(args.dir) / "references").resolve())
    files = UserFiles({case.key: file for case, file in found if file}, solver_files, references)
    return calibrate(Path(args.dir), args, say, files)
