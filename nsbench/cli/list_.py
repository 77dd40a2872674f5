"""`nsbench list`: registered cases, solvers and metrics, each with a line about it.

Cases and solvers that fail to load are listed with the reason.
"""

from __future__ import annotations

import argparse
import dataclasses
import inspect

from nsbench import solvers
from nsbench.case import broken_cases, case_module, case_names
from nsbench.cli.exit_codes import FINE

METRICS = {
    "state_sup": "largest error of the state over the sample times",
    "state_T": "error of the state at T",
    "set_distance": "distance of the states to the set of all solutions, where there are many",
    "impulse": "largest error of a cumulative impulse over the sample times",
    "reaction": "the same of the cumulative reaction, unique even where multipliers are not",
    "l1": "sum over sample intervals of the error of the interval's impulse",
    "settled": "largest error of an interval-mean multiplier away from events",
    "lam_own": "largest error of single steps' multipliers away from events, at the method's own "
    "time in the step",
    "lam_at_start": "the same against the exact multiplier at the start of the step",
    "lam_at_mid": "the same at its middle",
    "lam_at_end": "the same at its end",
    "lam_mean": "the same of its mean",
    "event_time": "largest error of a located event",
    "feasibility": "largest violation max(-g, 0)",
    "sign": "smallest multiplier",
    "complementarity": "largest product of gap and impulse",
    "residual": "residual of the equation",
    "selection": "distance to the least-norm multiplier (not an error)",
    "polyhedron": "distance of the multiplier to the set of all multipliers",
}


def command(args: argparse.Namespace, say) -> int:
    """List cases, solvers and metrics, or those of one kind."""
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
    for name in case_names():
        module = case_module(name)
        parameters = _parameters(module)
        line = f"  {name:<16} {_first_line(module)}"
        say(f"{line}  [{parameters}]" if parameters else line)
    _list_broken(broken_cases(), say)


def _list_solvers(say) -> None:
    for name in solvers.all_names():
        method = solvers.get(name)
        options = ", ".join(f"{f.name}={f.default}" for f in dataclasses.fields(method))
        say(f"  {name:<16} {_first_line(type(method))}  [{method.accuracy}; {options}]")
    _list_broken(solvers.broken(), say)


def _list_metrics(say) -> None:
    for name, text in METRICS.items():
        say(f"  {name:<16} {text}")


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
