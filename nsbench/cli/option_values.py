"""Conversion and checks of option values that several verbs share.

Each function raises ValueError (FileNotFoundError, LookupError) with a sentence that names the
option and its value; nsbench.cli.main turns these into exit code 2.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence
from types import SimpleNamespace

import numpy as np

from nsbench import solvers
from nsbench.case import Case, cases_of
from nsbench.case.selection import python_files, split_path

VALUES_PER_OCTAVE = 3.07  # of a range A..B: their ratios are not dyadic


def check_worker_options(args: argparse.Namespace) -> None:
    """Check -j, --timeout and --probe; replace --memory by its bytes. Raises ValueError.

    Options that the verb does not have are none to check.
    """
    if args.jobs is not None and args.jobs < 1:
        raise ValueError(f"-j is {args.jobs}; at least one worker is needed")
    solvers.check_positive("--timeout", getattr(args, "timeout", 1.0))
    if getattr(args, "probe", 0.0) and not 0.0 <= args.probe < float("inf"):
        raise ValueError(f"--probe is {args.probe:g}; a number of seconds is needed, 0 for none")
    if getattr(args, "memory", None) is not None:
        from nsbench.execute.workers.memory import parse_size

        args.memory = parse_size(args.memory)


def load_solver_files(args: argparse.Namespace) -> list[str]:
    """Register the methods of --solvers; return their names. Raises what solvers.load raises."""
    return [solvers.load(file) for path in args.solver_files for file in python_files(path)]


def check_cluster_options(args: argparse.Namespace) -> None:
    """Raise ValueError if --dask cannot be used, or not together with the other options."""
    from importlib.util import find_spec

    if args.dask is None:
        return
    if args.jobs is not None:
        raise ValueError(
            "-j is for workers on this machine, --dask for those of a cluster; give one of them"
        )
    if find_spec("distributed") is None:
        raise ValueError("--dask needs the package distributed: pip install 'nsbench[dask]'")


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


def find_cases(
    names: Iterable[str], suite: str = "standard", args: argparse.Namespace | None = None
) -> list[tuple[Case, str]]:
    """Build the cases of all names, each with its file (nsbench.case.selection), if they fit.

    args: with the worker options memory and jobs; None: those of one process. Raises ValueError
    with the foreseen size for a registered case that needs more memory than there is, LookupError
    or FileNotFoundError for a name that stands for nothing.
    """
    from nsbench.case.size import predicted_size
    from nsbench.execute.dry_run import check_memory

    out = []
    for name in names:
        if split_path(name) is None:
            limits = args or SimpleNamespace(memory=None, jobs=1)
            check_memory({name: predicted_size(name)}, limits)
        out += cases_of(name, suite)
    return out


def find_one_case(name: str) -> Case:
    """Build the case of a name; of a file with several parameter sets the first one."""
    return find_cases([name])[0][0]


def check_accuracies(specs: Iterable[str], values: Sequence[str]) -> None:
    """Raise LookupError if an accuracy is given that none of the methods takes.

    specs: of the methods that are asked for by name; values: names of the accuracies given.
    """
    methods = {spec: solvers.get(spec).accuracy for spec in specs}
    for name in values:
        if methods and name not in methods.values():
            spec, taken = next(iter(methods.items()))
            raise LookupError(f"{spec} takes {taken!r}, not {name!r}")
