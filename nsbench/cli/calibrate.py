"""`nsbench calibrate`: spread of the numbers of a study over starts 1e-12 apart."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

from nsbench.cli.option_values import check_worker_options


def command(args: argparse.Namespace, say: Callable[[str], None]) -> int:
    """Run a study again from perturbed starts and store the spreads in its folder."""
    from nsbench.gate.calibrate import calibrate
    from nsbench.results.consistency import check

    check_worker_options(args)
    check(args.dir)
    return calibrate(Path(args.dir), args, say)
