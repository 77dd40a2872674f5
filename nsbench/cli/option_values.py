"""Conversion and checks of option values that several verbs share.

Each function raises ValueError (FileNotFoundError, LookupError) with a sentence that names the
option and its value; nsbench.cli.main turns these into exit code 2.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from nsbench import solvers
from nsbench.case import Case, get_case

VALUES_PER_OCTAVE = 3.07  # of a range A..B: their ratios are not dyadic


def check_worker_options(args: argparse.Namespace) -> None:
    """Check -j, --timeout and --probe; replace --memory by its bytes. Raises ValueError."""
    if args.jobs is not None and args.jobs < 1:
        raise ValueError(f"-j is {args.jobs}; at least one worker is needed")
    solvers.check_positive("--timeout", args.timeout)
    if getattr(args, "probe", 0.0) and not 0.0 <= args.probe < float("inf"):
        raise ValueError(f"--probe is {args.probe:g}; a number of seconds is needed, 0 for none")
    if getattr(args, "memory", None) is not None:
        from nsbench.execute.workers.memory import parse_size

        args.memory = parse_size(args.memory)


def find_python_files(path: str | Path) -> list[Path]:
    """List the Python file at a path, or those in a folder that do not start with "_" or ".".

    Raises FileNotFoundError if there is none.
    """
    path = Path(path)
    if path.is_dir():
        files = sorted(p for p in path.glob("*.py") if not p.name.startswith(("_", ".")))
        if not files:
            raise FileNotFoundError(f"no case or solver file in {path}")
        return files
    if not path.is_file():
        raise FileNotFoundError(f"no file {path}")
    return [path]


def read_accuracies(args: argparse.Namespace) -> dict[str, str | float]:
    """Values of --h, --tol and --k by name, as far as they were given."""
    names = ("h", "tol", "k")
    return {n: getattr(args, n) for n in names if getattr(args, n) is not None}


def read_values(text: str) -> list[float]:
    """Read "1e-2", "1e-2,5e-3" or "1e-2..1e-4" (geometric, three per octave, not dyadic).

    Raises ValueError for a text that is none of these, and for values that are not positive.
    """
    try:
        if ".." in text:
            first, last = (float(v) for v in text.split(".."))
            values = [first, last]
            if first > 0 and last > 0:
                count = max(2, 1 + round(VALUES_PER_OCTAVE * abs(np.log2(first / last))))
                values = np.geomspace(first, last, count).tolist()
        else:
            values = [float(v) for v in text.split(",")]
    except ValueError:
        raise ValueError(f"cannot read {text!r}; write 1e-2, 1e-2,5e-3 or 1e-2..1e-4") from None
    for v in values:
        solvers.check_positive("accuracy", v)
    return values


def get_case_that_fits(key: str) -> Case:
    """Build a registered case, unless it is foreseen to need more memory than there is.

    Raises ValueError with the foreseen size in that case, LookupError for an unknown name.
    """
    from nsbench.case.size import predicted_size
    from nsbench.execute.dry_run import check_memory

    check_memory({key: predicted_size(key)}, SimpleNamespace(memory=None, jobs=1))
    return get_case(key)
