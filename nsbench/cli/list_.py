"""`nsbench list`: the registered cases and solvers, and the columns of a result.

Each comes with a line about it.

Cases and solvers that fail to load are listed with the reason.
"""

from __future__ import annotations

import argparse
import dataclasses
import inspect
from collections.abc import Callable

from nsbench import columns, solvers
from nsbench.case import (
    broken_cases,
    broken_plugin_cases,
    case_module,
    case_names,
    plugin_case_names,
)
from nsbench.cli.exit_codes import FINE
from nsbench.cli.option_values import load_solver_files


def command(args: argparse.Namespace, say: Callable[[str], None]) -> int:
    """List cases, solvers and metrics, or those of one kind."""
    load_solver_files(args)
    for kind, list_kind in (
        ("cases", _list_cases),
        ("solvers", _list_solvers),
        ("metrics", _list_metrics),
    ):
        if args.what in (None, kind):
            say(f"{kind}:" if args.what is None else "")
            list_kind(say)
    return FINE


def _list_cases(say) -> None:
    broken = broken_plugin_cases()
    for name in [*case_names(), *(n for n in plugin_case_names() if n not in broken)]:
        module = case_module(name)
        parameters = _parameters(module)
        line = f"  {name:<16} {_first_line(module)}"
        say(f"{line}  [{parameters}]" if parameters else line)
    _list_broken(broken_cases(), say)
    _list_broken(broken, say)


def _list_solvers(say) -> None:
    broken = solvers.broken_plugins()  # first: those that load are among all names then
    for name in solvers.all_names():
        method = solvers.get(name)
        options = ", ".join(f"{f.name}={f.default}" for f in dataclasses.fields(method))
        say(f"  {name:<16} {_first_line(type(method))}  [{method.accuracy}; {options}]")
    _list_broken(solvers.broken(), say)
    _list_broken(broken, say)


def _list_metrics(say) -> None:
    for name in columns.names():
        column = columns.describe(name)
        line = f"  {name:<18} {column.meaning}"
        say(f"{line}  [{column.unit}]" if column.unit else line)


def _list_broken(reasons: dict[str, str], say) -> None:
    for name, why in reasons.items():
        say(f"  {name:<16} FAILED TO LOAD: {why}")


def _first_line(documented) -> str:
    """First line of a docstring."""
    lines = (documented.__doc__ or "").strip().splitlines()
    return lines[0] if lines else "(says nothing of itself)"


def _parameters(module) -> str:
    """Parameters of a case with their defaults; "" for a case without."""
    if not hasattr(module, "make"):
        return ""
    parameters = inspect.signature(module.make).parameters
    return ", ".join(f"{name}={p.default}" for name, p in parameters.items())
