"""`nsbench report`: write the report of results again."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

from nsbench.cli.exit_codes import FINE
from nsbench.source_files.regular_files import exists


def command(args: argparse.Namespace, say: Callable[[str], None]) -> int:
    """Write report.html of each folder. Raises FileNotFoundError where there are no results."""
    from nsbench.report import write_report
    from nsbench.results.consistency import check

    for folder in map(Path, args.dirs):
        if not exists(folder / "runs.parquet"):
            raise FileNotFoundError(f"no results in {folder}")
        check(folder)
        say(str(write_report(folder, folder / "report.html")))
    return FINE
