"""`nsbench report`: write the report of results again."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

from nsbench.cli.exit_codes import FINE
from nsbench.source_files.regular_files import exists


def command(args: argparse.Namespace, say: Callable[[str], None]) -> int:
    """Write report.html of each folder. Raises FileNotFoundError where there are no results.

    Where the last run has written no tables, the report is of the rows that its journal holds.
    """
    from nsbench.report import write_report
    from nsbench.report.data import read_unfinished
    from nsbench.results.consistency import check, is_unfinished

    for folder in map(Path, args.dirs):
        unfinished = is_unfinished(folder)
        if unfinished:
            say(f"{folder}: {read_unfinished(folder).missing}")
        elif not exists(folder / "runs.parquet"):
            raise FileNotFoundError(f"no results in {folder}")
        else:
            check(folder)
        say(str(write_report(folder, folder / "report.html", unfinished=unfinished)))
    return FINE
